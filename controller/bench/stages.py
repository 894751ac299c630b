"""Measures the controller's work in a tick, stage by stage, in a loop that sleeps between ticks."""

from __future__ import annotations

import os
from typing import Any, Final

from haptic_wall.controller.bench.loops import AT_REST, FORGIVING, emulated_bus, told_by, wall_run
from haptic_wall.controller.bench.rows import Measurement, Section, over_rounds
from haptic_wall.controller.bench.stage_times import STAGES
from haptic_wall.controller.errors import PlatformError
from haptic_wall.controller.runtime.realtime import pick_cores
from haptic_wall.controller.settings.load import load_config

_ROUNDS, _SECONDS = 3, 1.0
_PERCENTILES: Final = ("p50", "p99")


def measure() -> Section:
    """Measure the work of a tick, in total and by stages; in its process and on a bus.

    Raises:
        ServoError: The servo could not be started.
        PlatformError: The bus or a loop could not be started, or ended too early.
    """
    whole: dict[str, list[dict[str, float]]] = {}
    timed: dict[str, list[dict[str, Any]]] = {}
    with emulated_bus() as path:
        servos = {
            "servo in the loop's process": ("simulated",),
            "servo on the emulated bus": ("xm430-w350", f"servo.port={path}", *AT_REST),
        }
        not_warmed_up = {
            f"{name}, no cache warm-up": (*run, "realtime.rehearse=false")
            for name, run in servos.items()
        }
        for _ in range(_ROUNDS):
            for name, (preset, *sets) in (servos | not_warmed_up).items():
                whole.setdefault(name, []).append(_whole_run(preset, *sets))
            for name, (preset, *sets) in servos.items():
                timed.setdefault(name, []).append(_timed_run(preset, *sets))
    rows: list[Measurement] = []
    for name, works in whole.items():
        rows += _whole_rows(name, works)
    for name in servos:
        rows += _stage_rows(name, timed[name])
    return Section(tuple(rows))


def _whole_run(preset: str, *sets: str) -> dict[str, float]:
    """Return percentiles of the work of a run's ticks [µs]."""
    ended = wall_run(preset, _SECONDS, *sets)
    report = ended.statistics.work.as_report(50, 99)
    found = {name: value for name, value in report.items() if value is not None}
    if ended.stop_reason != "duration" or not found:
        raise PlatformError(f"a run of {preset} did not run to its end: {ended.stop_reason}")
    return found


def _timed_run(preset: str, *sets: str) -> dict[str, Any]:
    """Return the figures of a loop that is timed stage by stage."""
    config = load_config(preset, (*FORGIVING, *sets)).config
    core, _ = pick_cores()
    orders = {
        "config": config.model_dump_json(),
        "parent": os.getpid(),
        "core": core,
        "seconds": _SECONDS,
    }
    words = ["haptic_wall.controller.bench.timed_loop"]
    figures = told_by("the timed loop", words, orders, _SECONDS, {core})
    if figures.get("stop_reason") != "duration":
        reason = figures.get("refused") or figures["stop_reason"]
        raise PlatformError(f"the timed loop on {preset} did not run to its end: {reason}")
    return figures


def _whole_rows(name: str, reports: list[dict[str, float]]) -> list[Measurement]:
    return [
        over_rounds(
            f"{name}: work of a tick, {percentile}",
            [report[percentile] for report in reports],
            "µs",
            "the wait for a bus, nor the effect of another program on the processor's caches",
        )
        for percentile in _PERCENTILES
    ]


def _stage_rows(name: str, runs: list[dict[str, Any]]) -> list[Measurement]:
    rows = [
        over_rounds(
            f"{name}: {stage}, {percentile}",
            [run["stages_us"][stage][place] for run in runs],
            "µs",
            "the undisturbed stage: its timing takes room in the caches, and is subtracted only on"
            " average",
        )
        for stage in STAGES
        for place, percentile in enumerate(_PERCENTILES)
    ]
    rows.append(
        over_rounds(
            f"{name}: timing one stage once, which is taken off",
            [run["timing_us"] for run in runs],
            "µs",
            "the tick of a run, in which nothing is timed",
        )
    )
    return rows
