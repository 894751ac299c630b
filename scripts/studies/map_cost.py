"""Measures the cost of maps: time, memory and disk, over points, processes and a cluster.

scripts/study map_cost [--quick] [--points N ...] [--rows FILE]
"""

from __future__ import annotations

import contextlib
import importlib
import itertools
import math
import os
import re
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from haptic_wall.controller.cli.map_files import json_parts, report_of, write_map
from haptic_wall.controller.experiments.maps.maps import MapQuestion, MapSettings, critical_map
from haptic_wall.controller.settings.load import load_config
from scripts.study import Found, Given, Option, Part, Study, length, table
from scripts.whole_program import PROGRAM

STEPS = range(10)
KICKS = (0.003, 0.01, 0.03, 0.1, 0.3)
CEILING = 2.0
"""Largest virtual damping [N·m·s/rad]: up to near the simulated servo's ceiling"""
PROJECTED = 1_000_000
NUMPY_POINTS = 200
"""A map without the compiler takes some twenty times as long"""


@dataclass(frozen=True, slots=True)
class Case:
    """A map, and what computes it."""

    points: int
    workers: int
    how: str
    """``processes``, ``dask``, or ``processes, NumPy alone``"""


@dataclass(frozen=True, slots=True)
class Cost:
    """What one map took."""

    wall_s: float
    processor_s: float | None
    """Of all its processes; None: a cluster's are not counted"""
    largest_mb: float
    """Memory of the largest process: the command, or one that it started"""
    disk_bytes: int
    load: float
    """Processes that ran or waited on the machine just before"""
    announced_mb: float | None = None
    """The memory of the plan at its start; None: it is too small for a plan"""


@dataclass(frozen=True, slots=True)
class Writing:
    """What this process does after and before the points are computed."""

    theory_s: float
    report_s: float
    write_s: float
    """The three files; all of the processor's time"""


def dampings(points: int) -> list[float]:
    """Return the virtual dampings of a map of about so many points."""
    count = max(1, round(points / (len(STEPS) * len(KICKS))))
    return [float(f"{value:.6g}") for value in np.linspace(0.0, CEILING, count)]


def cases(given: Given) -> list[Case]:
    """The maps; those of the cluster come last."""
    found = [Case(len(STEPS) * len(KICKS), 1, "processes")]
    found += [Case(NUMPY_POINTS, 1, f"processes{alone}") for alone in (", NumPy alone", "")]
    for workers in (2, 1):
        found += [Case(points, workers, "processes") for points in given.points]
    for workers in (2, 1):
        found += [Case(points, workers, "dask") for points in given.points]
    return found


@contextlib.contextmanager
def local_cluster(workers: int) -> Iterator[str]:
    """A scheduler and workers on this machine; gives its address."""
    distributed: Any = importlib.import_module("distributed")
    cluster = distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None
    )
    with cluster:
        yield cluster.scheduler_address


def cost(case: Case) -> Cost:
    """Run ``haptic-wall map`` once."""
    with contextlib.ExitStack() as during:
        folder = Path(during.enter_context(tempfile.TemporaryDirectory()))
        options = ["--workers", str(case.workers)]
        if case.how == "dask":
            options = ["--dask", during.enter_context(local_cluster(case.workers))]
        numpy_alone = "1" if "NumPy" in case.how else "0"
        began, load = time.perf_counter(), os.getloadavg()[0]
        said = during.enter_context(tempfile.TemporaryFile("w+"))
        command = subprocess.Popen(
            [
                *PROGRAM,
                *("map", "simulated", "--out", str(folder), "--json"),
                *("--set", "wall.side=both"),
                *("--virtual-damping", ",".join(map(str, dampings(case.points)))),
                *("--delay-steps", ",".join(map(str, STEPS))),
                *("--kick", ",".join(map(str, KICKS))),
                *options,
            ],
            stdout=subprocess.DEVNULL,
            stderr=said,
            env={**os.environ, "NUMBA_DISABLE_JIT": numpy_alone},
        )
        _, status, usage = os.wait4(command.pid, 0)
        command.returncode = os.waitstatus_to_exitcode(status)
        if command.returncode:
            raise RuntimeError(f"{case}: haptic-wall map ended with {command.returncode}")
        said.seek(0)
        announced = re.search(r"(\d+) MB of memory", said.read())
        return Cost(
            time.perf_counter() - began,
            None if case.how == "dask" else usage.ru_utime + usage.ru_stime,
            usage.ru_maxrss / 1024.0,
            sum(file.stat().st_size for file in folder.iterdir()),
            load,
            None if announced is None else float(announced[1]),
        )


def sizes(given: Given) -> list[int]:
    """The sizes of maps whose writing is measured."""
    return list(given.points)


def writing(points: int) -> Writing:
    """Measure what is done around the points, with made-up stiffnesses."""
    config = load_config("simulated", ("wall.side=both",)).config
    question = MapQuestion(MapSettings.of(config), dampings(points), STEPS, KICKS)
    done = {task: np.full((task.size, len(KICKS)), 12.345678901) for task in question.tasks()}
    times = [time.process_time()]
    found = critical_map(
        question.setting, question.dampings, question.delay_steps, question.kicks, done=done
    )
    times.append(time.process_time())
    report = report_of(found, "simulated")
    for _ in json_parts(found, report):
        pass
    times.append(time.process_time())
    with tempfile.TemporaryDirectory() as folder:
        write_map(found, report, Path(folder), force=False)
    times.append(time.process_time())
    return Writing(*(after - before for before, after in itertools.pairwise(times)))


def cost_lines(found: Found[Case, Cost]) -> list[str]:
    """The measured maps, their growth, and the projection."""
    rows = [
        (
            f"{case.points:,}",
            case.how,
            case.workers,
            f"{one.wall_s:.1f}",
            "" if one.processor_s is None else f"{one.processor_s:.1f}",
            f"{one.largest_mb:.0f}",
            "" if one.announced_mb is None else f"{one.announced_mb:.0f}",
            f"{one.disk_bytes / 1e6:.2f}",
            f"{one.load:.1f}",
        )
        for case, one in found
    ]
    head = "points|computed by|workers|time [s]|processor time [s]|largest process [MB]"
    more = ("announced [MB]", "files [MB]", "load before")
    return [*table([*head.split("|"), *more], *rows), "", *growth_lines(found)]


def growth_lines(found: Found[Case, Cost]) -> list[str]:
    """What grows how, by straight lines through the processor times, and what that comes to."""
    lines = []
    for workers in (1, 2):
        some = [
            (case.points, one)
            for case, one in found
            if case.how == "processes" and (case.workers == workers or case.points < 100)
        ]
        points = np.array([n for n, _ in some], dtype=np.float64)
        used = np.array([one.processor_s or 0.0 for _, one in some])
        memory = np.array([one.largest_mb for _, one in some])
        disk = np.array([one.disk_bytes / 1e6 for _, one in some])
        if points.size < 2:
            continue
        each, start = fitted(points, used)
        power = math.log(used[-1] / used[-2]) / math.log(points[-1] / points[-2])
        per_mb = (memory[-1] - memory[-2]) / (points[-1] - points[-2])  # buffers are full there
        per_disk, first_disk = fitted(points, disk)
        total = start + each * PROJECTED
        lines += [
            f"- {workers} of the processes: {start:.1f} s and {1e3 * each:.2f} ms a point of"
            " processor time; between the two largest maps it grows with the points to the power"
            f" {power:.2f}. {PROJECTED:,} points: {length(total)} of processor time,"
            f" {length(total / workers)} on {workers} free core{'s' if workers > 1 else ''},"
            f" {memory[-1] + per_mb * (PROJECTED - points[-1]):,.0f} MB in the largest process,"
            f" {first_disk + per_disk * PROJECTED:,.0f} MB of files."
        ]
    return lines


def fitted(points: np.ndarray[Any, Any], values: np.ndarray[Any, Any]) -> tuple[float, float]:
    """Return slope and start of a line through the values, with equal relative weights."""
    slope, start = np.polyfit(points, values, 1, w=1.0 / np.maximum(values, 1e-9))
    return float(slope), float(start)


def writing_lines(found: Found[int, Writing]) -> list[str]:
    """What one process does around the points."""
    rows = [
        (
            f"{points:,}",
            *(f"{value:.2f}" for value in (one.theory_s, one.report_s, one.write_s)),
            f"{1e6 * (one.theory_s + one.report_s + one.write_s) / points:.0f}",
        )
        for points, one in found
    ]
    head = "points|theory's limits [s]|report and answer [s]|three files [s]|all, a point [µs]"
    return table(head.split("|"), *rows)


POINTS = Option("points", (1000, 10_000, 100_000), "sizes of maps", quick=(200, 500))
STUDY = Study(
    "evidence/map-cost.md",
    (
        Part("maps", cases, cost, cost_lines, case_s=60.0, in_turn=True),
        Part("writing", sizes, writing, writing_lines, case_s=5.0, in_turn=True),
    ),
    (POINTS,),
)
