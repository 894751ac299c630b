"""Measures the cost of the live page for the loop, and the page's own latency.

    scripts/study live_cost [--quick] [--only PART]

Needs a Chromium for the parts `opening` and `latency`, and a machine that does nothing else. The
status is 1 where a number is not the one that is wanted.
"""

from __future__ import annotations

import contextlib
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.logs.file import read_log
from scripts.chromium import Tab, chromium, program
from scripts.live_clients import client
from scripts.page_and_loop import SERVOS, address_of, cheap, cost, cost_lines, percentiles, turns
from scripts.page_times import ages_ms, close, opening, pictures, prepare
from scripts.study import Found, Option, Part, Study, table
from scripts.whole_program import PROGRAM, children_of

PATIENCE_S = 60.0
MOST_BYTES, MOST_CURVE_S, MOST_PIXEL_MS, MOST_GROWTH_MB = 300_000, 1.0, 50.0, 5.0


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


def origin_s(folder: Path) -> float:
    """Return the zero of a run's times on the monotonic clock [s]."""
    return 1e-9 * float(read_log(folder / "run.hwlog")[1]["deadline_ns"][0])


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
        with (
            browser(folder / "browser") as tab,
            run_with_page(folder, "--set", "servo.hand=push") as (_, address),
        ):
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
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name,
        run_with_page(Path(name)) as (run, address),
    ):
        time.sleep(4.0)
        pid = children_of(run.pid).get("page")
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
        f" {row.before:.1f} MB before and {row.most:.1f} MB at most; {row.buffered:.1f} MB wait in"
        f" the system's buffers of the connection. Wanted: less than {MOST_GROWTH_MB:g} MB more. "
        + ("It holds." if row.most - row.before < MOST_GROWTH_MB else "It does not hold.")
        for seconds, row in found
    ]


STUDY = Study(
    "evidence/live-cost.md",
    (
        *(
            Part(
                name,
                partial(turns, servo=servo),
                cost,
                cost_lines,
                case_s=10.0,
                in_turn=True,
                wanted=cheap,
            )
            for name, servo in SERVOS.items()
        ),
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
        Option("rounds", 5, "rounds of all modes, for each servo", quick=1),
        Option("seconds", 7.0, "duration of each run [s]", quick=4.0),
        Option("openings", 3, "openings of each kind", quick=1),
        Option("follow", 15.0, "time for which pictures are followed [s]", quick=4.0),
        Option("silent", 60.0, "time for which a client reads nothing [s]", quick=5.0),
    ),
)
