"""What the live page costs the loop, and how soon the page shows what happens.

    scripts/study live_cost [--quick] [--only PART]

Needs a Chromium for the parts `opening` and `latency`, and a machine that does nothing else. The
status is 1 where a number is not the one that is wanted.
"""

from __future__ import annotations

import contextlib
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.bench.loops import FORGIVING
from haptic_wall.controller.bench.torque_frames import torque_frames
from haptic_wall.controller.emulated_bus.record import read_rows
from haptic_wall.controller.logs.file import read_log
from haptic_wall.controller.runtime.realtime import pick_cores
from scripts.chromium import Tab, chromium, program
from scripts.live_clients import client
from scripts.page_times import ages_ms, close, opening, pictures, prepare
from scripts.study import Found, Given, Option, Part, Study, table
from scripts.whole_program import PROGRAM, ROOT, child_of, with_sets

PATIENCE_S = 60.0
SKIPPED_S, END_S = 2.0, 0.2
"""Ignored time at the beginning of a run, in which clients come, and at its end [s]"""
SERVOS = ("simulated", "emulated-xm430")
MODES = {"no page": None, "no page, again": None, "one client": 1, "20 clients": 20}
"""Clients of the page by the name of the mode; None: there is no page"""
MOST_RATIO, MOST_BYTES, MOST_CURVE_S, MOST_PIXEL_MS, MOST_GROWTH_MB = 1.05, 300_000, 1.0, 50.0, 5.0


@contextlib.contextmanager
def run_with_page(folder: Path, *options: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A run of the simulated servo, and the address of its page; its log is ``run.hwlog``."""
    words = [*PROGRAM, "run", "simulated", "--no-plot", "--live", "--duration", "inf", *options]
    run = subprocess.Popen(
        [*words, "--log", str(folder / "run.hwlog"), "--force"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        process_group=0,
    )
    try:
        yield run, address_of(run)
    finally:
        run.send_signal(signal.SIGINT)
        run.communicate(timeout=PATIENCE_S)


def address_of(run: subprocess.Popen[str]) -> str:
    """Wait for the address of a run's page."""
    assert run.stderr is not None
    said = ""
    for line in run.stderr:
        if line.startswith("live: "):
            return line.removeprefix("live: ").strip()
        said += line
    raise RuntimeError(f"the run did not start: {said}")


def origin_s(folder: Path) -> float:
    """Return the zero of a run's times on the monotonic clock [s]."""
    return 1e-9 * float(read_log(folder / "run.hwlog")[1]["deadline_ns"][0])


# What it costs the loop.


class Case(NamedTuple):
    """A run that is measured."""

    servo: str
    mode: str
    turn: int
    seconds: float


@dataclass(frozen=True, slots=True)
class Cost:
    """Figures of one run; NaN: it had too few ticks [µs]."""

    late_p50: float
    late_p99: float
    frames_p50: float
    """Deviation of the interval of two torques from the period"""
    frames_p99: float


FIGURES = {
    "late_p50": "lateness, p50",
    "late_p99": "lateness, p99",
    "frames_p50": "torque intervals, p50",
    "frames_p99": "torque intervals, p99",
}


def turns(given: Given) -> list[Case]:
    """Every mode in each round; each round begins with another one."""
    modes, found = list(MODES), []
    for turn in range(given.rounds):
        for servo in SERVOS:
            for k in range(len(modes)):
                found.append(Case(servo, modes[(turn + k) % len(modes)], turn, given.seconds))
    return found


def cost(case: Case) -> Cost:
    """Run a wall once in a mode, and return its figures."""
    clients = MODES[case.mode]
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        log, record = Path(name) / "run.hwlog", Path(name) / "bus.csv"
        words = [*PROGRAM, "run", case.servo, "--no-plot", "--json", "--log", str(log)]
        words += ["--duration", str(case.seconds)]
        if case.servo != "simulated":
            words += ["--witness", str(record), *with_sets(tuple(FORGIVING))]
        if clients is not None:
            words.append("--live")
        run = subprocess.Popen(
            words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, process_group=0
        )
        readers = None
        if clients is not None:
            readers = subprocess.Popen(
                [
                    *[sys.executable, "-m", "scripts.live_clients", address_of(run)],
                    *[str(clients), str(case.seconds + PATIENCE_S)],
                ],
                cwd=ROOT,
                stdout=subprocess.PIPE,
                text=True,
            )
            os.sched_setaffinity(readers.pid, pick_cores()[1])  # as if on another machine
        _, said = run.communicate(timeout=PATIENCE_S + case.seconds)
        if run.returncode:
            raise RuntimeError(f"{case} ended with {run.returncode}: {said}")
        if readers is not None and not int(readers.communicate(timeout=PATIENCE_S)[0]):
            raise RuntimeError(f"{case}: the clients read nothing")
        rows = read_log(log)[1]
        if case.servo == "simulated":
            sent_s = 1e-9 * (rows["sampled_ns"] + rows["age_ns"])[rows["sampled_ns"] > 0]
        else:
            sent_s = torque_frames(read_rows(record))
    began_s, ended_s = (1e-9 * float(rows["deadline_ns"][k]) for k in (0, -1))
    inside = (began_s + SKIPPED_S, ended_s - END_S)
    due_s = 1e-9 * rows["deadline_ns"]
    late_us = 1e-3 * rows["lateness_ns"][(due_s > inside[0]) & (due_s < inside[1])]
    frames_us = 1e6 * np.abs(np.diff(sent_s[(sent_s > inside[0]) & (sent_s < inside[1])]) - 1e-3)
    return Cost(*percentiles(late_us), *percentiles(frames_us))


def percentiles(values: NDArray[np.float64]) -> tuple[float, float]:
    """Median and 99th percentile."""
    if len(values) < 100:
        return float("nan"), float("nan")
    return float(np.percentile(values, 50)), float(np.percentile(values, 99))


def ratios(found: Found[Case, Cost], servo: str, mode: str, figure: str) -> list[float]:
    """A figure over that without a page, round by round."""
    of = {(case.mode, case.turn): row for case, row in found if case.servo == servo}
    return [
        getattr(row, figure) / getattr(of["no page", turn], figure)
        for (name, turn), row in of.items()
        if name == mode and ("no page", turn) in of
    ]


def cost_lines(found: Found[Case, Cost]) -> list[str]:
    """A line for each servo and mode."""
    rows = []
    for servo in SERVOS:
        for mode in MODES:
            of = [row for case, row in found if (case.servo, case.mode) == (servo, mode)]
            cells = []
            for figure in FIGURES:
                middle = statistics.median(getattr(row, figure) for row in of)
                if mode == "no page":
                    cells.append(f"{middle:.3g} µs")
                else:
                    each = ratios(found, servo, mode, figure)
                    cells.append(f"{statistics.median(each):.2f} ({min(each):.2f}–{max(each):.2f})")
            rows.append([f"`{servo}`", mode, *cells])
    first = found[0][0]
    count = max(case.turn for case, _ in found) + 1
    over = [
        f"`{servo}`, {mode}, {words}"
        for servo in SERVOS
        for mode, clients in MODES.items()
        for figure, words in FIGURES.items()
        if clients is not None
        and statistics.median(ratios(found, servo, mode, figure)) > MOST_RATIO
    ]
    return [
        *table(["servo", "mode", *FIGURES.values()], *rows),
        "",
        f"{count} rounds of {first.seconds:g} s, load of the machine {os.getloadavg()[0]:.1f}."
        " Ratios to `no page` of the same round: median and range."
        f" Wanted: every median at most {MOST_RATIO:g}. "
        + (f"It is more for: {'; '.join(over)}." if over else "It holds."),
    ]


def cheap(found: Found[Case, Cost]) -> bool:
    """Whether no median ratio is more than is wanted."""
    return all(
        statistics.median(ratios(found, servo, mode, figure)) <= MOST_RATIO
        for servo in SERVOS
        for mode, clients in MODES.items()
        for figure in FIGURES
        if clients is not None
    )


# How soon the page opens.


class Open(NamedTuple):
    """A page that is opened."""

    running: bool
    """Whether the run has begun long before"""
    warm: bool
    """Whether the browser has shown a page of this kind before"""
    turn: int


@dataclass(frozen=True, slots=True)
class Opened:
    """Times from the navigation [s]."""

    bytes: int
    paint_s: float
    curve_s: float
    row_s: float
    """When the first row was written; less than 0: before"""


@contextlib.contextmanager
def browser(folder: Path) -> Iterator[Tab]:
    """A browser with the clock in its pages."""
    if program() is None:
        sys.exit("live_cost needs a Chromium: found none of chromium, google-chrome on PATH")
    with chromium(folder) as tab:
        prepare(tab)
        yield tab


def opened(case: Open) -> Opened:
    """Open a page once."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        with browser(folder / "browser") as tab:
            if case.warm:
                with run_with_page(folder) as (_, address):
                    opening(tab, address)
                    close(tab)
            with run_with_page(folder) as (_, address):
                if case.running:
                    time.sleep(4.0)
                found = opening(tab, address)
                close(tab)
        row_s = origin_s(folder) - found.opened_s
    return Opened(found.bytes, found.paint_s, found.curve_s, row_s)


def opened_lines(found: Found[Open, Opened]) -> list[str]:
    """A line for each kind of opening."""
    rows = []
    for running in (False, True):
        for warm in (False, True):
            of = [row for case, row in found if case[:2] == (running, warm)]
            if of:
                cells = [
                    middle_and_range([getattr(row, name) for row in of])
                    for name in ("paint_s", "curve_s")
                ]
                first = "before" if running else middle_and_range([row.row_s for row in of])
                words = "runs" if running else "starts"
                rows.append([words, "warm" if warm else "cold", f"{len(of)}", *cells, first])
    size = max(row.bytes for _, row in found)
    head = ["the run", "browser", "tries", "first paint, s", "first curve, s"]
    return [
        *table([*head, "first row of the run, s"], *rows),
        "",
        f"Transferred: {size / 1000:.0f} kB, headers included (wanted: below"
        f" {MOST_BYTES // 1000} kB). Wanted: the first curve within {MOST_CURVE_S:g} s. "
        + ("It holds." if soon(found) else "It does not hold in every try."),
    ]


def soon(found: Found[Open, Opened]) -> bool:
    """Whether each page was small and soon."""
    return all(row.bytes < MOST_BYTES and row.curve_s < MOST_CURVE_S for _, row in found)


def middle_and_range(values: Sequence[float]) -> str:
    """Median, least and largest."""
    return f"{statistics.median(values):.2f} ({min(values):.2f}–{max(values):.2f})"


# How late a sample is shown.


@dataclass(frozen=True, slots=True)
class Latency:
    """Of a page that follows a run."""

    per_s: float
    """Pictures [1/s]"""
    drawn_p50: float
    """From a row's deadline to the end of the drawing [ms]"""
    drawn_p99: float
    shown_p50: float
    """From a row's deadline to the compositor [ms]"""
    shown_p99: float
    followed: int
    """Pictures that were followed to the compositor"""


def latency(seconds: float) -> Latency:
    """Follow the newest second of a run."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        with browser(folder / "browser") as tab:
            with run_with_page(folder, "--set", "servo.hand=push") as (_, address):
                opening(tab, address)
                seen = pictures(tab, seconds)
                close(tab)
        newest_s = origin_s(folder) + seen.newest_s
    drawn, shown = (percentiles(ages_ms(newest_s, at)) for at in (seen.drawn_s, seen.shown_s))
    followed = int(np.isfinite(seen.shown_s).sum())
    return Latency(len(newest_s) / seconds, *drawn, *shown, followed)


def latency_lines(found: Found[float, Latency]) -> list[str]:
    """Two lines: drawn and shown."""
    rows = [
        line
        for seconds, row in found
        for line in (
            ["drawn by the page", f"{row.drawn_p50:.0f}", f"{row.drawn_p99:.0f}"],
            ["shown by the compositor", f"{row.shown_p50:.0f}", f"{row.shown_p99:.0f}"],
        )
    ]
    return [
        *table(["every row of the run", "median, ms", "p99, ms"], *rows),
        "",
        *(
            f"{row.per_s:.0f} pictures a second for {seconds:g} s; {row.followed} of them were"
            f" followed to the compositor. Wanted: the median below {MOST_PIXEL_MS:g} ms. "
            + ("It holds." if row.shown_p50 < MOST_PIXEL_MS else "It does not hold.")
            for seconds, row in found
        ),
    ]


# What a client costs that never reads.


@dataclass(frozen=True, slots=True)
class Memory:
    """Own memory of the server [MB]."""

    before: float
    most: float
    buffered: float
    """That the system keeps for the client, at the end"""


def memory(seconds: float) -> Memory:
    """Watch the server while a client reads nothing."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        with run_with_page(Path(name)) as (run, address):
            time.sleep(4.0)
            pid = child_of(run.pid, "live.process")
            if pid is None:
                raise RuntimeError("the page has no process")
            with client(address):  # so that what serves a first client is there before
                time.sleep(2.0)
            with client(address) as link:
                before = most = own_mb(pid)
                end_s = time.monotonic() + seconds
                while time.monotonic() < end_s:
                    time.sleep(0.5)
                    most = max(most, own_mb(pid))
                waiting = pending_mb(link.getsockname()[1])
    return Memory(before, most, waiting)


def own_mb(pid: int) -> float:
    """Anonymous memory of a process: without files, and without the shared rows [MB]."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("RssAnon:"):
            return int(line.split()[1]) / 1024
    raise RuntimeError("the system does not tell a process's own memory")


def pending_mb(port: int) -> float:
    """Bytes in the system's two buffers of a connection on this machine, by its port [MB]."""
    total = 0
    for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        _, local, remote, _, queues, *_ = line.split()
        if port in (int(local.rpartition(":")[2], 16), int(remote.rpartition(":")[2], 16)):
            total += sum(int(each, 16) for each in queues.split(":"))
    return total / (1 << 20)


def memory_lines(found: Found[float, Memory]) -> list[str]:
    """A sentence."""
    return [
        f"A client connects and reads nothing for {seconds:g} s. The server's own memory is"
        f" {row.before:.1f} MB before and {row.most:.1f} MB at most; {row.buffered:.1f} MB wait in the"
        f" system's buffers of the connection. Wanted: less than {MOST_GROWTH_MB:g} MB more. "
        + ("It holds." if row.most - row.before < MOST_GROWTH_MB else "It does not hold.")
        for seconds, row in found
    ]


STUDY = Study(
    "evidence/live-cost.md",
    (
        Part("loop", turns, cost, cost_lines, case_s=10.0, in_turn=True, wanted=cheap),
        Part(
            "opening",
            lambda given: [
                Open(running, warm, turn)
                for turn in range(given.openings)
                for running in (False, True)
                for warm in (False, True)
            ],
            opened,
            opened_lines,
            case_s=8.0,
            in_turn=True,
            wanted=soon,
        ),
        Part(
            "latency",
            lambda given: [given.follow],
            latency,
            latency_lines,
            case_s=25.0,
            in_turn=True,
            wanted=lambda found: all(row.shown_p50 < MOST_PIXEL_MS for _, row in found),
        ),
        Part(
            "memory",
            lambda given: [given.silent],
            memory,
            memory_lines,
            case_s=70.0,
            in_turn=True,
            wanted=lambda found: all(row.most - row.before < MOST_GROWTH_MB for _, row in found),
        ),
    ),
    (
        Option("rounds", 5, "rounds of all modes on both servos", quick=1),
        Option("seconds", 7.0, "duration of each run [s]", quick=4.0),
        Option("openings", 3, "openings of each kind", quick=1),
        Option("follow", 15.0, "time for which pictures are followed [s]", quick=4.0),
        Option("silent", 60.0, "time for which a client reads nothing [s]", quick=5.0),
    ),
)
