"""One run of the whole program with injected faults, and the findings about it."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from haptic_wall.controller.bench.loops import FORGIVING
from haptic_wall.controller.runtime.telemetry import ROW
from scripts.chaos.faults import NO_REPORT
from scripts.chaos.judge import Injected
from scripts.chaos.stage import Fault, Lasting, Stage
from scripts.whole_program import CHILDREN, PROGRAM, emulated_bus, with_sets

WATCHDOG_S, PATIENT_WATCHDOG_S = 0.04, 0.5
SETTINGS = (
    f"servo.watchdog_s={WATCHDOG_S}",
    "safety.heartbeat_s=0.1",
    "safety.max_loss=0.3",
    "safety.max_silence_s=0.02",
    "realtime.profile=best-effort",
)
"""Watchdog and heartbeat as for hardware; the losses that a shared machine's stalls cost do not end
a run"""
WALL = ("wall.position=3.14159", "wall.stiffness=8", "wall.damping=0.02", "model.delay=0")
TRUTH = ("servo.position=2.9", "servo.hand=lean", "servo.hand_origin=3.14159")
"""A hand leans on the wall, so that there is a torque at nearly all times"""
POLL_S, SAMPLE_S = 0.01, 2.0
START_S, END_S, AFTER_S = 40.0, 60.0, 0.6
"""How long a run may take to begin, and to end when asked; how long the torque is watched after"""
PROMPT_PRIORITY = 60
"""Below emulator and loop; but a signal that ends a stop must not wait behind busy processes"""


@dataclass(frozen=True, slots=True)
class Course:
    """Plan of one run."""

    seconds: float
    faults: Iterator[Fault]
    patient: bool
    """A long run, which is to live through the machine's stalls"""

    @property
    def watchdog_s(self) -> float:
        """Time of the Bus Watchdog [s]."""
        return PATIENT_WATCHDOG_S if self.patient else WATCHDOG_S


NAME, DID_NOT_START = "haptic-wall", "did not start"


@dataclass(slots=True)
class Run:
    """A run with injected faults, and its result."""

    reason: str = DID_NOT_START
    injected: list[Injected] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    said: str = ""
    """On standard error"""
    began_s: float = 0.0
    stopped_s: float = 0.0
    """When the loop last spoke, by the witness [s]"""
    ended_s: float = 0.0
    """When its last process had ended, the report and the picture made [s]"""
    memory: dict[tuple[str, int], list[tuple[float, float]]] = field(default_factory=dict)
    """Memory of each process, by name and pid: time since it was first seen [s], resident memory
    [MB]"""
    strangers: int = 0
    """How often programs of others were seen at real-time priority"""
    cause: str | None = None
    """Event that explains the reason; None: none does"""
    off_s: float | None = None
    """From the fault that ended it to the last torque [s]"""
    witnessed: bool = True
    """The witness lived to the end"""
    rows: int = 0
    goals: int = 0
    """Goals that the witness saw from the first row on"""
    lost: int = 0
    """Rows that the report says the log lacks"""
    torque_problems: list[str] = field(default_factory=list)
    log_problems: list[str] = field(default_factory=list)
    other_problems: list[str] = field(default_factory=list)

    @property
    def refused(self) -> bool:
        """It never began, and said why: a start is refused where nothing is certain yet."""
        return not self.began_s and f"{DID_NOT_START}: {NAME}: " in self.reason

    @property
    def problems(self) -> list[str]:
        """Everything that should not have been."""
        return [*self.torque_problems, *self.log_problems, *self.other_problems]


@contextlib.contextmanager
def promptly() -> Iterator[None]:
    """Run ahead of ordinary processes, where that is granted; children do not inherit it."""
    with contextlib.suppress(OSError):
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy, os.sched_param(PROMPT_PRIORITY))
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def perform(course: Course, folder: Path, room: Path | None, core: int, random: Random) -> Run:
    """Start a bus and a run, inject the kills and faults of the course, and await the end.

    Args:
        course: The kills and faults of the run.
        folder: Folder for the witness, and for the log where there is no room for it.
        room: A small file system for the log; None: there is none.
        core: The loop's.
        random: Decides which fault is injected when.
    """
    run = Run()
    log = (room or folder) / "run.hwlog"
    log.unlink(missing_ok=True)
    cores = tuple(sorted(os.sched_getaffinity(0)))
    sets = (*FORGIVING, *WALL) if course.patient else (*SETTINGS, *WALL)
    with socket.create_server(("127.0.0.1", 0)) as free:
        page_port: int = free.getsockname()[1]
    output, said = folder / "report.json", folder / "said.txt"
    with (
        emulated_bus("--record", folder / "witness.csv", *with_sets(TRUTH)) as bus,
        output.open("wb") as report_file,
        said.open("wb") as said_file,
    ):
        os.sched_setaffinity(bus.process.pid, set(cores) - {core} or set(cores))
        process = subprocess.Popen(
            [
                *[*PROGRAM, "run", "xm430-w350", "--json", "--log", str(log)],
                *["--plot", str(folder / "run.png"), "--live", f"127.0.0.1:{page_port}"],
                *with_sets((f"servo.port={bus.port}", *sets)),
            ],
            stdin=subprocess.DEVNULL,
            stdout=report_file,
            stderr=said_file,
        )
        stage = Stage(bus, process, log, room, core, cores, random, page_port)
        pending: list[tuple[float, Lasting]] = []
        try:
            with promptly():
                _with_faults(course, stage, run, pending)
        finally:
            for _, lasting in pending:
                lasting.undo()
            if process.poll() is None:
                process.kill()
            process.wait()
            for name in CHILDREN:
                if not _gone(stage.pids.get(name)):
                    run.other_problems.append(f"the {name} outlived the run")
                    stage.send(name, signal.SIGKILL)
        time.sleep(AFTER_S)
        run.witnessed = bus.process.poll() is None
    run.said = said.read_text(errors="replace")
    text = output.read_text()
    if text:
        report = json.loads(text)
        run.reason, run.warnings = report["stop_reason"], report["warnings"]
    elif run.began_s and process.returncode == -signal.SIGKILL:
        run.reason = NO_REPORT
    elif not run.began_s:
        run.reason = f"{DID_NOT_START}: {_last_line(run.said)}"
    else:
        run.reason = f"ended with {process.returncode}: {_last_line(run.said)}"
    return run


def _last_line(said: str) -> str:
    return next((line for line in reversed(said.splitlines()) if line.strip()), "it said nothing")


def _with_faults(
    course: Course, stage: Stage, run: Run, pending: list[tuple[float, Lasting]]
) -> None:
    """Inject faults from the start of a run to its end; leave those to be undone in ``pending``."""
    process, random = stage.run, stage.random
    if not _begun(stage):
        return
    run.began_s = start = next_sample = time.monotonic()
    next_fault = start + random.uniform(1.0, 4.0)
    asked_s: float | None = None
    fault: Fault | None = None
    samples: dict[tuple[str, int], list[tuple[float, float]]] = defaultdict(list)
    while process.poll() is None:
        now = time.monotonic()
        for due in [each for each in pending if each[0] <= now]:
            pending.remove(due)
            due[1].undo()
        alive = not _gone(stage.pids.get("loop"), 0.0)
        if alive and now >= next_sample:
            next_sample += SAMPLE_S
            for name, pid in stage.look().items():
                samples[name, pid].append((now, _resident_mb(pid)))
        if fault is None:
            fault = next(course.faults)
        if alive and asked_s is None and now >= next_fault and fault.ready(stage):
            lasting = fault.inject(stage)
            until = time.monotonic() + lasting.seconds
            struck_s = now if lasting.from_s is None else lasting.from_s
            run.injected.append(Injected(fault.name, struck_s, until, lasting.detail))
            pending.append((until, lasting))
            next_fault = now + random.uniform(1.0, 5.0)
            fault = None
        if asked_s is None and now >= start + course.seconds and not pending:
            asked_s = now
            process.send_signal(signal.SIGINT)
        if asked_s is not None and now > asked_s + END_S:
            run.other_problems.append(
                f"it had not ended {END_S:g} s after it was asked to ({_doing(stage.look())})"
            )
            process.kill()
            break
        time.sleep(POLL_S)
    run.ended_s = time.monotonic()
    run.memory = {
        seen: [(t - each[0][0], mb) for t, mb in each if mb > 0.0] for seen, each in samples.items()
    }
    if asked_s is not None:
        run.injected.append(Injected(ASKED, asked_s, run.ended_s))


ASKED = "asked to end"


def _begun(stage: Stage) -> bool:
    """Wait until the wall is on."""
    enough = 700 * ROW.itemsize
    end = time.monotonic() + START_S
    while stage.run.poll() is None and time.monotonic() < end:
        if stage.log.exists() and stage.log.stat().st_size > enough and "loop" in stage.look():
            return True
        time.sleep(POLL_S)
    return False


def _gone(pid: int | None, patience_s: float = 5.0) -> bool:
    """Whether a process ends in time; one that only waits for its parent to ask is gone."""
    end = time.monotonic() + patience_s
    while pid is not None:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return True
        if state in "ZX":
            return True
        if time.monotonic() >= end:
            return False
        time.sleep(POLL_S)
    return True


def _doing(pids: dict[str, int]) -> str:
    """Names of the processes that are there, each with its state."""
    words = []
    for name, pid in pids.items():
        with contextlib.suppress(OSError):
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
            words.append(f"{name} {state} in {Path(f'/proc/{pid}/wchan').read_text()}")
    return ", ".join(words)


def _resident_mb(pid: int) -> float:
    """Resident memory without the ring of rows, which is shared, and touched row by row [MB]."""
    with contextlib.suppress(OSError):
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
        words = (line.split() for line in lines)
        sizes = {word[0]: int(word[1]) for word in words if word[0].startswith(("VmRSS", "RssSh"))}
        return (sizes.get("VmRSS:", 0) - sizes.get("RssShmem:", 0)) / 1024
    return 0.0
