"""Faults of a run: each strikes one process, or several, while a hand leans on the wall."""

import contextlib
import os
import pty
import resource
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from haptic_wall.controller.runtime.telemetry import Telemetry, Word
from scripts.whole_program import PROGRAM, Bus, children_of

HANGS = """
import os, signal, sys

def compute_for_ever(*_):
    while True:
        pass

def write_for_ever(*_):
    _, full = os.pipe()
    while True:
        os.write(full, bytes(4096))

if "haptic_wall.controller.processes.loop_process" in sys.orig_argv:
    signal.signal(signal.SIGUSR1, compute_for_ever)
    signal.signal(signal.SIGUSR2, write_for_ever)
"""
"""A ``sitecustomize.py`` that teaches the loop's process to hang; the program itself cannot"""
COMPUTE, WRITE = signal.SIGUSR1, signal.SIGUSR2


@dataclass(slots=True)
class Target:
    """A run into which faults are injected."""

    run: subprocess.Popen[bytes]
    bus: Bus
    log: Path
    terminal: int
    """The controlling end of the terminal it was started from"""
    pids: dict[str, int] = field(default_factory=dict)
    words: memoryview | None = None
    """The control words, which outlive the run here"""
    loop_struck_s: float = 0.0
    """When the loop got its first signal [s]: of several, a stall may come between two; 0: none"""

    def find(self) -> bool:
        """Look for its processes; whether all are there."""
        self.pids = {"supervisor": self.run.pid, **children_of(self.run.pid)}
        with contextlib.suppress(OSError):
            if self.words is None:
                self.words = Telemetry.of(self.run.pid).words
        return (
            self.run.poll() is None
            and self.pids.keys() >= {"loop", "recorder", "door"}
            and self.words is not None
        )

    def ready(self, rows: int) -> bool:
        """Whether so many rows are recorded."""
        return self.find() and self.words is not None and self.words[Word.TAIL] >= rows

    def send(self, number: signal.Signals, *names: str) -> None:
        """Send a signal to some of its processes."""
        for name in names:
            if name == "loop":
                self.loop_struck_s = self.loop_struck_s or time.monotonic()
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pids[name], number)

    def end_survivors(self, patience_s: float) -> int:
        """How many processes of a run that is over do not end in time; they are ended here."""
        end = time.monotonic() + patience_s
        while time.monotonic() < end:
            there = [name for name, pid in self.pids.items() if Path(f"/proc/{pid}/exe").exists()]
            if not there:
                return 0
            time.sleep(0.05)
        self.send(signal.SIGKILL, *there)
        return len(there)

    def hang_up(self) -> None:
        """Close the terminal, as when its window is closed."""
        os.close(self.terminal)
        self.terminal = -1


@contextlib.contextmanager
def target(bus: Bus, folder: Path, arguments: list[str]) -> Iterator[Target]:
    """A run in a terminal of its own; what it says on standard output goes to a file.

    Args:
        bus: The emulated bus it drives.
        folder: For its files: log, ``output`` and ``said``.
        arguments: Arguments of ``haptic-wall run``.
    """
    (folder / "sitecustomize.py").write_text(HANGS)
    log = folder / "run.hwlog"
    paths = (str(folder), os.environ.get("PYTHONPATH"))
    ours, theirs = pty.openpty()
    with (folder / "output").open("wb") as output, (folder / "said").open("wb") as said:
        run = subprocess.Popen(
            ["setsid", "--ctty", *PROGRAM, "run", *arguments, "--log", log, "--json"],
            stdin=theirs,
            stdout=output,
            stderr=said,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))},
        )
    os.close(theirs)
    struck = Target(run, bus, log, ours)
    try:
        yield struck
    finally:
        if run.poll() is None:
            run.send_signal(signal.SIGCONT)
            run.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            run.wait(30)
        if struck.terminal >= 0:
            os.close(struck.terminal)


@dataclass(frozen=True, slots=True)
class Fault:
    """A way to strike a run."""

    name: str
    inject: Callable[[Target], object]
    then: Callable[[Target], object] = lambda _: None
    """Fault that follows"""
    later_s: float = 1.0
    """How much later [s]"""
    goes_on: bool = False
    """The run must not end of it"""

    @property
    def strikes_the_torque(self) -> bool:
        """Whether no loop renders the wall any more, so that the torque must end in time."""
        return not self.goes_on and (
            "loop" in self.name or not self.name.startswith(("supervisor", "recorder", "door"))
        )


def sent(number: signal.Signals, *names: str) -> Callable[[Target], None]:
    """A signal to some processes."""
    return lambda target: target.send(number, *names)


def killed_together(*names: str) -> Callable[[Target], None]:
    """SIGKILL to several, stopped first: none may act on the other's death."""

    def inject(target: Target) -> None:
        target.send(signal.SIGSTOP, *names)
        target.send(signal.SIGKILL, *names)

    return inject


def killed_unwatched(target: Target) -> None:
    """The loop is killed while the supervisor does not look."""
    target.send(signal.SIGSTOP, "supervisor")
    target.send(signal.SIGKILL, "loop")


def orphaned(number: signal.Signals) -> Callable[[Target], None]:
    """The loop hangs, and its supervisor is killed."""

    def inject(target: Target) -> None:
        target.send(signal.SIGSTOP, "supervisor")
        target.send(number, "loop")
        time.sleep(0.005)
        target.send(signal.SIGKILL, "supervisor")

    return inject


def full_disk(target: Target) -> None:
    """The log may not become longer."""
    size = target.log.stat().st_size
    resource.prlimit(target.pids["recorder"], resource.RLIMIT_FSIZE, (size, -1))


def room_again(target: Target) -> None:
    """The log may become longer again."""
    resource.prlimit(target.pids["recorder"], resource.RLIMIT_FSIZE, (-1, -1))


STOP, CONT, KILL = signal.SIGSTOP, signal.SIGCONT, signal.SIGKILL
ALL = ("supervisor", "loop", "recorder")
FAULTS = (
    Fault("loop: SIGKILL", sent(KILL, "loop")),
    Fault("loop: SIGSTOP", sent(STOP, "loop")),
    Fault("loop: SIGSTOP, SIGCONT after 100 ms", sent(STOP, "loop"), sent(CONT, "loop"), 0.1),
    Fault("loop: computes for ever", sent(COMPUTE, "loop")),
    Fault("loop: blocked in a write", sent(WRITE, "loop")),
    Fault("supervisor: SIGKILL", sent(KILL, "supervisor")),
    Fault("supervisor: SIGTERM", sent(signal.SIGTERM, "supervisor")),
    Fault("supervisor: SIGHUP, its terminal closed", Target.hang_up),
    Fault("supervisor: Ctrl-Z", sent(signal.SIGTSTP, "supervisor")),
    Fault(
        "supervisor: SIGSTOP for 1 s",
        sent(STOP, "supervisor"),
        sent(CONT, "supervisor"),
        goes_on=True,
    ),
    Fault("supervisor: SIGSTOP for 1 s; loop: SIGKILL", killed_unwatched, sent(CONT, "supervisor")),
    Fault("supervisor and loop: SIGKILL", killed_together("supervisor", "loop")),
    Fault("supervisor: SIGKILL; loop: stopped", orphaned(STOP)),
    Fault("supervisor: SIGKILL; loop: computes for ever", orphaned(COMPUTE)),
    Fault("supervisor, loop and recorder: SIGKILL", killed_together(*ALL)),
    Fault("recorder: SIGKILL", sent(KILL, "recorder"), goes_on=True),
    Fault(
        "recorder: SIGSTOP for 1 s", sent(STOP, "recorder"), sent(CONT, "recorder"), goes_on=True
    ),
    Fault("recorder: SIGSTOP until the end", sent(STOP, "recorder"), goes_on=True),
    Fault("recorder: no room on the disk for 1 s", full_disk, room_again, goes_on=True),
    Fault("door: SIGKILL", sent(KILL, "door"), goes_on=True),
    Fault("door: SIGSTOP until the end", sent(STOP, "door"), goes_on=True),
    Fault("adapter: unplugged", lambda target: target.bus.inject("unplug-adapter")),
    Fault("cable: no byte arrives any more", lambda target: target.bus.inject("drop")),
)
