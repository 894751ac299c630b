"""Presses Ctrl-C while each command begins, and writes docs/ctrl-c.md: how it ended.

    scripts/ctrl_c [--tries N] [--others N] [--minutes M] [--only TEXT] [--results FILE] ...

At a random time in the first seconds, or in as many as the command takes. The signal goes to
the whole foreground group, as from a terminal. SIGTERM and a closed terminal are tried too.
The page is written anew every few tries; with --results a later call goes on where one ended.
"""

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from haptic_wall.controller.cli.interrupt import INTERRUPTED
from haptic_wall.hw.clock import MonotonicClock
from haptic_wall.hw.dynamixel.link import Link
from haptic_wall.hw.dynamixel.port import open_port
from haptic_wall.hw.dynamixel.serial_line import FdLine
from haptic_wall.hw.dynamixel.tables import REGISTERS
from scripts.whole_program import (
    emulated_bus,
    measured_on,
    page_options,
    say_time,
    with_sets,
)

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
BATCH = 20
"""Tries of one command in a row"""
CASES: dict[str, tuple[str, ...]] = {
    "identify": ("identify", *SERVO),
    "run": ("run", *SERVO),
    "run, simulated": ("run", "simulated", "--set", "realtime.profile=off"),
    "run, emulated": ("run", "emulated-xm430", "--set", "realtime.profile=off"),
    "identify, in memory": ("identify", *IN_MEMORY),
    "delay": ("delay", *SERVO),
    "rendered": ("rendered", *SERVO),
    "sweep": ("sweep", *SERVO, "--virtual-damping=0.01", "--delay-steps=0"),
    "sweep, side by side": ("sweep", *IN_MEMORY, "--virtual-damping=0,0.1", "--delay-steps=1,3"),
    "commission": ("commission", *SERVO, "--yes", "--out", "out"),
    "commission, in memory": ("commission", *IN_MEMORY, "--out", "out"),
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
    "detect": ("detect", "{log}", "--plot", "detect.png"),
    "log": ("log", "{log}", "--csv", "log.csv", "--plot", "log.png"),
    "config": ("config", "simulated"),
    "presets": ("presets",),
    "init": ("init", "made.yaml"),
    "help": ("help",),
}
SIGNALS = {
    signal.SIGINT: "Ctrl-C",
    signal.SIGHUP: "SIGHUP, the terminal closed",
    signal.SIGTERM: "SIGTERM",
}
TRACES = ("Traceback", "Exception ignored", "KeyboardInterrupt", "leaked", "Fatal Python error")
"""Texts that no user should have to read"""


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
        return self.before or (soon and self.name != "emulate")

    @property
    def trace(self) -> bool:
        """Whether it said what nobody should have to read."""
        return any(word in self.said for word in TRACES)

    @property
    def asked(self) -> bool:
        """Whether its status says that it was interrupted, or ended by the signal itself."""
        by_itself = self.name == "emulate" and self.number != signal.SIGINT and self.status == 0
        return self.status in (INTERRUPTED, -self.number) or by_itself

    @property
    def as_wanted(self) -> bool:
        """Whether it ended as one that is asked to end should."""
        quiet = not (self.trace or self.torque or self.left or self.half)
        return quiet and (self.done or (self.asked and self.ended_s <= LIMIT_S))


def torque_enable(port: str) -> int | None:
    """Read the servo's register, once nobody uses the bus any more."""
    line = FdLine(open_port(port, BAUD), MonotonicClock())
    try:
        link = Link(line, 1)
        for _ in range(5):
            until_ns = time.monotonic_ns() + 100_000_000
            found = link.read_register(REGISTERS["torque_enable"], until_ns)
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


def duration_s(words: Sequence[str], span_s: float) -> float:
    """How long a command takes that nobody interrupts, up to a span [s]."""
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


def measure(
    name: str, words: Sequence[str], number: signal.Signals, times: list[float], jobs: int
) -> list[Try]:
    """A try of one command for each of the times [s], a few tries at once."""
    found: list[Try] = []

    def work() -> None:
        with bus_for(words) as port, contextlib.suppress(IndexError):
            given = [word.replace("{port}", port) for word in words]
            while True:
                found.append(one_try(name, given, number, times.pop(), port))

    threads = [threading.Thread(target=work) for _ in range(jobs)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


def row(tries: Sequence[Try]) -> str:
    """A line of the table."""
    meant = [each for each in tries if not each.done]
    states = Counter(str(each.status) for each in meant)
    cells = [
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
    return f"| {' | '.join(cells)} |"


def tell(strange: Try) -> None:
    """Show what went wrong, to whoever waits."""
    facts = f"{strange.status} {strange.ended_s:.2f} s later, torque {strange.torque}"
    said = "\n    ".join(strange.said.splitlines()[-20:])
    print(
        f"{strange.name}, {strange.number.name} after {strange.after_s:.3f} s: {facts},"
        f" {strange.left} left, {strange.half} half\n    {said}",
        file=sys.stderr,
        flush=True,
    )


def page(tries: Sequence[Try], span_s: float) -> str:
    """The page, of tries in the first seconds ``span_s``."""
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
    return "\n".join(
        [
            "# Ctrl-C while a command begins",
            "",
            "Written by `scripts/ctrl_c`. Each command is begun as from a terminal, and the signal"
            f" sent at a random time of its first {span_s:g} s, or of as many as it takes: while"
            " Python starts, while libraries load, while processes are started, in the warm-up and"
            " the first motion. Where a servo is needed it is driven as a real one, on an emulated"
            " bus of its own; afterwards its register is read.",
            measured_on() + f" Its load was {os.getloadavg()[2]:.0f} meanwhile.",
            "",
            "- *done*: the command was at its end before the signal came.",
            "- *exit*: exit statuses and how often; 130: interrupted. A negative one is the"
            " signal's own, where nothing of the program had begun, or nothing had to be put in"
            " order: a shell says 130 of -2 too.",
            "- *longest*: from the signal to the end.",
            "- *traces*: a traceback, an ignored exception or a warning of Python's own was read.",
            "- *torque on*: by the servo's register, when the command had ended.",
            "- *left*, *half*: processes that stayed behind, files that are not whole.",
            "",
            "| signal | command | tries | done | exit | longest, s | traces | torque on | left |"
            " half |",
            "|---|---|---|---|---|---|---|---|---|---|",
            *(row(group) for group in groups if group),
            "",
            f"Wanted: the end within {LIMIT_S:g} s, and none of the rest. {end} None in n tries"
            " still allows, at 95 %, for 3 in n.",
            "",
        ]
    )


def recorded(folder: Path) -> str:
    """A log to look at."""
    log = folder / "a.hwlog"
    words = ["run", *IN_MEMORY, "--duration", "20", "--log", str(log), "--plot", f"{log}.png"]
    subprocess.run([COMMAND, *words], check=True, capture_output=True)
    return str(log)


def kept(results: Path | None) -> list[Try]:
    """The tries of earlier calls."""
    if results is None or not results.exists():
        return []
    read = (Try(**json.loads(line)) for line in results.read_text().splitlines())
    return [replace(each, number=signal.Signals(each.number)) for each in read]


def keep(results: Path | None, tries: Sequence[Try]) -> None:
    """Add tries to a file; of those that went well it keeps no words."""
    if results is not None:
        with results.open("a") as file:
            for each in tries:
                one = replace(each, said="") if each.as_wanted else each
                file.write(json.dumps(asdict(one)) + "\n")


def batches(
    wanted: dict[signal.Signals, int], only: str, made: Sequence[Try]
) -> Iterator[tuple[str, signal.Signals, int]]:
    """List the trials: the commands that matter most first, the others by turns.

    Args:
        wanted: How many tries of each command, by signal.
        only: Text in the names of the commands that are tried.
        made: Tries that need not be made again.
    """
    count = Counter((each.name, each.number) for each in made)
    names = [name for name in CASES if only in name]
    first = [name for name in names if name in FIRST]
    rest = [name for name in names if name not in FIRST]
    for number, tries in wanted.items():
        for some in (first, rest):
            for begun in range(0, tries, BATCH):
                for name in some:
                    until = min(begun + BATCH, tries)
                    if (lacking := until - max(begun, count[name, number])) > 0:
                        yield name, number, lacking


def main() -> None:
    """Try, write the page."""
    parser = page_options("ctrl_c", __doc__, "ctrl-c.md")
    parser.add_argument("--tries", type=int, default=500, help="of each command by Ctrl-C")
    parser.add_argument("--others", type=int, default=30, help="of each by the other signals")
    parser.add_argument("--span", type=float, default=2.0, metavar="S", help="the first seconds")
    parser.add_argument("--only", default="", metavar="TEXT", help="commands with this in the name")
    parser.add_argument("--jobs", type=int, default=2, help="at a time")
    parser.add_argument("--minutes", type=float, default=600.0, help="the longest it may take")
    parser.add_argument(
        "--results", type=Path, metavar="FILE", help="keeps the tries, and those of earlier calls"
    )
    given = parser.parse_args()
    # Begun in the background of a script, this would hand on that Ctrl-C is ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    wanted = {
        number: given.tries if number == signal.SIGINT else given.others for number in SIGNALS
    }
    tries = kept(given.results)
    plan = list(batches(wanted, given.only, tries))
    end_s = time.monotonic() + 60.0 * given.minutes
    usual_s = sum(lacking for _, _, lacking in plan) * given.span / given.jobs
    say_time(min(usual_s, 60.0 * given.minutes))
    spans: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        log = recorded(Path(folder))
        for name, number, lacking in plan:
            if time.monotonic() > end_s:
                break
            words = [word.replace("{log}", log) for word in CASES[name]]
            if name not in spans:
                spans[name] = duration_s(words, given.span)
            times = [random.random() * spans[name] for _ in range(lacking)]
            found = measure(name, words, number, times, given.jobs)
            for each in found:
                if not each.as_wanted:
                    tell(each)
            keep(given.results, found)
            tries += found
            given.out.write_text(page(tries, given.span))
    print(page(tries, given.span))
    sys.exit(not all(each.as_wanted for each in tries))


if __name__ == "__main__":
    main()
