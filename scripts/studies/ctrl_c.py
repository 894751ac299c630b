"""Presses Ctrl-C while each command begins, and checks its end.

    scripts/study ctrl_c [--only PART] [--tries N] [--others N] [--span S] [--commands TEXT]

At a random time in the first seconds, or in as many as the command takes. The signal goes to
the whole foreground group, as from a terminal. SIGTERM and a closed terminal are tried too. It
takes a night; with --rows a later call goes on where one ended.
"""

import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

from haptic_wall.controller.cli.interrupt import INTERRUPTED
from haptic_wall.controller.processes.started import run
from haptic_wall.hw.clock import MonotonicClock
from haptic_wall.hw.dynamixel.link import Link
from haptic_wall.hw.dynamixel.port import open_port
from haptic_wall.hw.dynamixel.serial_line import FdLine
from haptic_wall.hw.dynamixel.tables import REGISTERS
from scripts.study import Found, Given, Option, Part, Study, table
from scripts.whole_program import emulated_bus, with_sets

COMMAND = Path(sys.executable).with_name("haptic-wall")
LIMIT_S = 6.0
"""The longest that may pass from a signal to the end [s]; 1 s or 2 on a machine with time"""
PATIENCE_S = 20.0
GONE_S = 2.0
"""How long processes of a command may outlive it [s]"""
JUST_ENDED_S = 0.1
"""A command that ends well so soon after a signal was at its end already [s]"""
BAUD = 4_000_000
SERVO = (
    "xm430-w350",
    *with_sets(
        (
            "servo.port={port}",
            "servo.watchdog_s=0.5",
            "safety.max_loss=1",
            "safety.max_silence_s=0.25",
            "safety.heartbeat_s=2",
            "realtime.profile=off",
        )
    ),
)
"""A servo on a bus of its own, as a real one is driven; patient with a busy machine's stalls"""
IN_MEMORY = ("simulated", "--set", "loop.clock=simulated")
FIRST = ("identify", "run")
"""Tried before the others"""
JOBS = 2
"""Tries at a time"""
BATCH = 20
"""Tries of one command in a row"""
SERVES = ("emulate", "live", "demo")
"""Commands that go on until they are interrupted"""
CASES: dict[str, tuple[str, ...]] = {
    "identify": ("identify", *SERVO),
    "run": ("run", *SERVO),
    "run, simulated": ("run", "simulated", "--set", "realtime.profile=off"),
    "run, emulated": ("run", "emulated-ideal", "--set", "realtime.profile=off"),
    "identify, in memory": ("identify", *IN_MEMORY),
    "delay": ("delay", *SERVO),
    "rendered": ("rendered", *SERVO),
    "sweep": ("sweep", *SERVO, "--virtual-damping=0.01", "--delay-steps=0"),
    "sweep, side by side": ("sweep", *IN_MEMORY, "--virtual-damping=0,0.1", "--delay-steps=1,3"),
    "zwidth": ("zwidth", *SERVO, "--yes", "--out", "out"),
    "zwidth, in memory": ("zwidth", *IN_MEMORY, "--out", "out"),
    "commission": ("commission", *SERVO, "--yes", "--out", "out"),
    "commission, in memory": ("commission", *IN_MEMORY, "--out", "out"),
    "acceptance": ("acceptance", *SERVO, "--yes", "--out", "out"),
    "acceptance, in memory": ("acceptance", *IN_MEMORY, "--out", "out"),
    "doctor": ("doctor", *SERVO),
    "scan": ("scan", "--port", "{port}"),
    "emulate": ("emulate", "--servo", "XM430-W350:1", "--record", "record.csv"),
    "map": ("map", "simulated", "--out", "out"),
    "bench": ("bench",),
    "paper": ("paper", "all", "--out", "out"),
    "boundary": (
        *("boundary", "--inertia=1e-4", "--damping=1e-3", "--period=1e-3", "--delay=1e-3"),
        *("--virtual-damping=0.01,0.02", "--plot", "boundary.png"),
    ),
    "set": ("set", "wall.stiffness=4", "--run", "{run}"),
    "detect": ("detect", "{log}", "--plot", "detect.png"),
    "live": ("live", "{log}"),
    "demo": ("demo",),
    "log": ("log", "{log}", "--csv", "log.csv", "--plot", "log.png"),
    "config": ("config", "simulated"),
    "presets": ("presets",),
    "init": ("init", "made.yaml"),
    "help": ("help",),
}
LATER = ("zwidth", "acceptance", "set", "live", "demo")
"""Commands in a part of their own: they came later, and are tried less often"""
SIGNALS = {
    signal.SIGINT: "Ctrl-C",
    signal.SIGHUP: "SIGHUP, the terminal closed",
    signal.SIGTERM: "SIGTERM",
}
TRACES = ("Traceback", "Exception ignored", "KeyboardInterrupt", "leaked", "Fatal Python error")
"""Texts that must not be in the output"""


@dataclass(frozen=True, slots=True)
class Try:
    """Result of one signal."""

    name: str
    number: signal.Signals
    after_s: float
    """When it was sent"""
    before: bool
    """The command was done before"""
    status: int | None
    """Of its exit; None: it did not end"""
    ended_s: float
    """From the signal to the end"""
    said: str
    torque: int | None
    """Torque Enable afterwards; None: there is no servo, or it could not be read"""
    left: int
    """Processes that stayed behind"""
    half: int
    """Files that are not whole"""

    @property
    def done(self) -> bool:
        """Whether it was at its end already when the signal came."""
        soon = self.status == 0 and self.ended_s < JUST_ENDED_S
        return self.before or (soon and self.name not in SERVES)

    @property
    def trace(self) -> bool:
        """Whether its output has a text of ``TRACES``."""
        return any(word in self.said for word in TRACES)

    @property
    def asked(self) -> bool:
        """Whether its status says that it was interrupted, or ended by the signal itself."""
        by_itself = self.name in SERVES and self.number != signal.SIGINT and self.status == 0
        return self.status in (INTERRUPTED, -self.number) or by_itself

    @property
    def as_wanted(self) -> bool:
        """Whether it ended as one that is asked to end should."""
        quiet = not (self.trace or self.torque or self.left or self.half)
        return quiet and (self.done or (self.asked and self.ended_s <= LIMIT_S))


def torque_enable(port: str) -> int | None:
    """Read the servo's register, when the bus is free."""
    line = FdLine(open_port(port, BAUD), MonotonicClock())
    try:
        link = Link(line, 1)
        for _ in range(5):
            found = link.read_register(REGISTERS["torque_enable"], 100_000_000)
            if found is not None:
                return found
        return None
    finally:
        line.close()


def members(session: int) -> list[int]:
    """The processes of a session that are alive."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                if int(fields[3]) == session and fields[0] != "Z":
                    found.append(int(entry.name))
    return found


def end_survivors(session: int) -> int:
    """How many processes of a session do not end in time; they are ended here."""
    end = time.monotonic() + GONE_S
    while (left := members(session)) and time.monotonic() < end:
        time.sleep(0.02)
    for pid in left:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    return len(left)


def send(process: subprocess.Popen[bytes], number: signal.Signals) -> None:
    """As a terminal does: to all of the foreground group; SIGTERM to the command alone."""
    with contextlib.suppress(ProcessLookupError):
        if number == signal.SIGTERM:
            process.send_signal(number)
        else:
            os.killpg(process.pid, number)


def one_try(
    name: str, words: Sequence[str], number: signal.Signals, after_s: float, port: str
) -> Try:
    """Begin a command in a folder of its own, and send it a signal."""
    with tempfile.TemporaryDirectory(prefix="ctrl-c-") as folder, tempfile.TemporaryFile() as out:
        process = subprocess.Popen(
            [COMMAND, *words],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=out,
            start_new_session=True,
        )
        time.sleep(after_s)
        before = process.poll() is not None
        sent = time.monotonic()
        send(process, number)
        status = None
        with contextlib.suppress(subprocess.TimeoutExpired):
            status = process.wait(PATIENCE_S)
        ended_s = time.monotonic() - sent
        left = end_survivors(process.pid) - (status is None)
        process.wait()
        half = sum(".part" in path.name for path in Path(folder).rglob("*"))
        out.seek(0)
        said = out.read().decode(errors="replace")
    torque = torque_enable(port) if port else None
    return Try(name, number, after_s, before, status, ended_s, said, torque, left, half)


@contextlib.contextmanager
def bus_for(words: Sequence[str]) -> Iterator[str]:
    """The port of an emulated bus, where the command wants one; else nothing."""
    if not any("{port}" in word for word in words):
        yield ""
        return
    with emulated_bus("--die-with-parent", "--servo", "XM430-W350:1", "--baud", str(BAUD)) as bus:
        yield bus.port


@contextlib.contextmanager
def with_wall(words: Sequence[str]) -> Iterator[Sequence[str]]:
    """The words, with the log of a running wall where the command wants one."""
    if "{run}" not in words:
        yield words
        return
    with run("simulated", ["realtime.profile=off"]) as wall:
        yield [word.replace("{run}", str(wall.log)) for word in words]


def duration_s(words: Sequence[str], span_s: float) -> float:
    """How long a command takes without a signal, up to a span [s]."""
    with tempfile.TemporaryDirectory() as folder, bus_for(words) as port:
        began = time.monotonic()
        process = subprocess.Popen(
            [COMMAND, *(word.replace("{port}", port) for word in words)],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(span_s)
        took_s = time.monotonic() - began
        process.terminate()
        process.wait()
    return min(took_s, span_s)


class Batch(NamedTuple):
    """Tries of one command in a row."""

    name: str
    number: signal.Signals
    begun: int
    """Tries before"""
    tries: int
    span_s: float


@cache
def span_of(name: str, span_s: float) -> float:
    """How long a command takes, at most the first seconds that are looked at [s]."""
    with (
        tempfile.TemporaryDirectory() as folder,
        with_wall(words_of(name, Path(folder))) as words,
    ):
        return duration_s(words, span_s)


def words_of(name: str, folder: Path) -> list[str]:
    """A command's words; where it wants a log, one is recorded in the folder."""
    words = CASES[name]
    log = recorded(folder) if "{log}" in words else ""
    return [word.replace("{log}", log) for word in words]


def measure(batch: Batch) -> list[Try]:
    """Try one command, some at once; of tries that ended as wanted the words are not kept."""
    span_s = span_of(batch.name, batch.span_s)
    with (
        tempfile.TemporaryDirectory() as folder,
        ThreadPoolExecutor(JOBS) as threads,
        with_wall(words_of(batch.name, Path(folder))) as words,
    ):

        def work(tries: int) -> list[Try]:
            with bus_for(words) as port:
                given = [word.replace("{port}", port) for word in words]
                times = [random.random() * span_s for _ in range(tries)]
                return [one_try(batch.name, given, batch.number, at, port) for at in times]

        shares = [(batch.tries + job) // JOBS for job in range(JOBS)]
        found = [one for some in threads.map(work, filter(None, shares)) for one in some]
    for one in found:
        if not one.as_wanted:
            tell(one)
    return [replace(one, said="") if one.as_wanted else one for one in found]


def batches(given: Given, *, later: bool = False) -> Iterator[Batch]:
    """List a part's trials: the commands that matter most first, the others by turns."""
    names = [name for name, words in CASES.items() if (words[0] in LATER) == later]
    names = [name for name in names if given.commands in name]
    first = [name for name in names if name in FIRST]
    rest = [name for name in names if name not in FIRST]
    for number in SIGNALS:
        tries = given.tries if number == signal.SIGINT else given.others
        for some in (first, rest):
            for begun in range(0, tries, BATCH):
                for name in some:
                    yield Batch(name, number, begun, min(BATCH, tries - begun), given.span)


def as_a_terminal(_given: Given) -> contextlib.nullcontext[None]:
    """Heed Ctrl-C and the terminal's end, which a script in the background leaves ignored."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    return contextlib.nullcontext()


def cells(tries: Sequence[Try]) -> list[str]:
    """A line of the table."""
    meant = [each for each in tries if not each.done]
    states = Counter(str(each.status) for each in meant)
    return [
        SIGNALS[tries[0].number],
        tries[0].name,
        str(len(tries)),
        str(len(tries) - len(meant)),
        ", ".join(f"{status}: {count}" for status, count in states.most_common()) or "–",
        f"{max((each.ended_s for each in meant), default=0.0):.2f}",
        str(sum(each.trace for each in tries)),
        str(sum(bool(each.torque) for each in tries))
        if "{port}" in str(CASES[tries[0].name])
        else "–",
        str(sum(each.left for each in tries)),
        str(sum(each.half for each in tries)),
    ]


def tell(strange: Try) -> None:
    """Print the facts of a failed try on standard error."""
    facts = f"{strange.status} {strange.ended_s:.2f} s later, torque {strange.torque}"
    said = "\n    ".join(strange.said.splitlines()[-20:])
    print(
        f"{strange.name}, {strange.number.name} after {strange.after_s:.3f} s: {facts},"
        f" {strange.left} left, {strange.half} half\n    {said}",
        file=sys.stderr,
        flush=True,
    )


def every_try(found: Found[Batch, list[Try]]) -> list[Try]:
    """All tries of all batches."""
    return [one for _, tries in found for one in tries]


def as_wanted(found: Found[Batch, list[Try]]) -> bool:
    """Whether every one ended as it should."""
    return all(one.as_wanted for one in every_try(found))


def lines(found: Found[Batch, list[Try]]) -> list[str]:
    """A line for each signal and command."""
    tries = every_try(found)
    wrong = sum(not each.as_wanted for each in tries)
    end = (
        f"It holds in all {len(tries)} tries."
        if not wrong
        else f"It does not hold in {wrong} of {len(tries)} tries."
    )
    groups = (
        [each for each in tries if (each.name, each.number) == (name, number)]
        for number in SIGNALS
        for name in CASES
    )
    head = ["signal", "command", "tries", "done", "exit", "longest, s", "traces", "torque on"]
    return [
        *table([*head, "left", "half"], *(cells(group) for group in groups if group)),
        "",
        f"Wanted: the end within {LIMIT_S:g} s, and none of the rest. {end} None in n tries"
        " still allows, at 95 %, for 3 in n.",
    ]


def recorded(folder: Path) -> str:
    """A log to look at."""
    log = folder / "a.hwlog"
    words = ["run", *IN_MEMORY, "--duration", "20", "--log", str(log), "--plot", f"{log}.png"]
    subprocess.run([COMMAND, *words], check=True, capture_output=True)
    return str(log)


STUDY = Study(
    "evidence/ctrl-c.md",
    tuple(
        Part(
            name,
            partial(batches, later=later),
            measure,
            lines,
            case_s=30.0,
            in_turn=True,
            around=as_a_terminal,
            wanted=as_wanted,
        )
        for name, later in (("signals", False), ("later", True))
    ),
    (
        Option("tries", 500, "interruptions of each command by Ctrl-C"),
        Option("others", 30, "interruptions of each command by each other signal"),
        Option("span", 2.0, "interrupt within this time from the start [s]"),
        Option("commands", "", "only commands with this text in their name"),
    ),
)
