"""Measures how regular torque frames arrive at the bus and what a cycle works, beside a bare loop.

The record of the emulated bus is the reference of the intervals, not the loops' own statistics.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.bench.bare_loop import (
    GOAL_CURRENT_0,
    PERCENTILES,
    READ_16_AT_120,
    REPLY_BYTES,
)
from haptic_wall.controller.bench.loops import BAUD, LOOPS, Turn, emulated_bus
from haptic_wall.controller.bench.rows import Measurement, Section, compared, over_rounds
from haptic_wall.controller.emulated_bus.record import BusRow, read_rows
from haptic_wall.controller.errors import PlatformError
from haptic_wall.hw.dynamixel.codec import Instruction
from haptic_wall.hw.dynamixel.wire import wire_ns

_ROUNDS, _SECONDS, _RATE_HZ = 7, 4.0, 1000.0
_START_S, _END_S = 0.2, 0.05
"""Ignored time at the beginning and the end of a loop"""
_CYCLE_BYTES: Final = len(READ_16_AT_120) + REPLY_BYTES + len(GOAL_CURRENT_0)
_BACKLOG_US: Final = 1.1e-3 * wire_ns(_CYCLE_BYTES, BAUD)
"""Torque frames closer than this have waited for a delayed bus, because no loop makes up for
skipped periods"""


def measure() -> Section:
    """Measure how far each loop's intervals are off the period, and its work; the ratios too.

    Raises:
        ServoError: The servo could not be started.
        PlatformError: The bus or a loop could not be started, or sent hardly any torques.
    """
    turns: dict[str, list[tuple[float, float]]] = {name: [] for name in LOOPS}
    told: dict[str, list[Turn]] = {name: [] for name in LOOPS}
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / "bus.csv"
        with emulated_bus(record=str(record)) as path:
            for _ in range(_ROUNDS):
                for name, loop in LOOPS.items():
                    began_s = time.monotonic()
                    told[name].append(loop(path, _SECONDS, _RATE_HZ, 1))
                    turns[name].append((began_s, time.monotonic()))
        sent_s = torque_frames(read_rows(record))
    intervals = {
        name: [intervals_us(sent_s, *turn, _SECONDS, _RATE_HZ) for turn in each]
        for name, each in turns.items()
    }
    own = {name: [each[~held_up(each)] for each in turns] for name, turns in intervals.items()}
    period_us = 1e6 / _RATE_HZ
    deviations = {
        name: [_percentiles(np.abs(each - period_us)) for each in turns]
        for name, turns in own.items()
    }
    work_us = {name: [turn.work_us for turn in each] for name, each in told.items()}
    return Section(
        (
            *_compared("deviation of torque frames' intervals from the period", deviations),
            *_compared("work of a cycle without its waits", work_us),
            *_left_out(intervals),
        )
    )


def torque_frames(rows: Iterable[BusRow]) -> NDArray[np.float64]:
    """Return the times of goal currents sent by sync write [s]; shape (n,)."""
    wanted = Instruction.SYNC_WRITE
    return np.array([r.time_s for r in rows if r.event == "rx" and r.instruction == wanted])


def intervals_us(
    sent_s: NDArray[np.float64], began_s: float, ended_s: float, seconds: float, rate_hz: float
) -> NDArray[np.float64]:
    """Return the intervals between a loop's torque frames [µs].

    Args:
        sent_s: Times of the torque frames [s], shape (n,).
        began_s: When the loop's process was started [s].
        ended_s: When it had ended [s].
        seconds: How long it sent torques [s]; the time before was its start.
        rate_hz: Rate of the loop.

    Returns:
        Intervals in the order of time, shape (m,).

    Raises:
        PlatformError: The loop sent fewer than half of the expected frames.
    """
    own = sent_s[(sent_s >= began_s) & (sent_s <= ended_s)]
    if own.size:
        last_s = own[-1]
        own = own[(own > last_s - seconds + _START_S) & (own < last_s - _END_S)]
    due = (seconds - _START_S - _END_S) * rate_hz
    if own.size < 0.5 * due:
        raise PlatformError(
            f"found {own.size} torque frames of a loop",
            wanted=f"about {due:.0f}",
            advice="the machine is too busy; try again when it is not",
        )
    intervals: NDArray[np.float64] = np.diff(own) * 1e6
    return intervals


def held_up(intervals_us: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which intervals are invalid because frames had to wait for the bus.

    Invalid are: the interval in which the bus stood still, the intervals between the frames that
    waited meanwhile, and the interval after them.

    Args:
        intervals_us: Intervals between the torque frames of a loop [µs], shape (n,).

    Returns:
        Shape (n,).
    """
    together: NDArray[np.bool_] = np.pad(intervals_us <= _BACKLOG_US, 1)
    of_the_bus: NDArray[np.bool_] = together[:-2] | together[1:-1] | together[2:]
    return of_the_bus


def _percentiles(values: NDArray[np.float64]) -> dict[int, float]:
    return {p: float(np.percentile(values, p)) for p in PERCENTILES}


def _compared(what: str, told: dict[str, list[dict[int, float]]]) -> list[Measurement]:
    """Return the rows of a quantity, whose percentiles each loop tells of each round [µs]."""
    rows = []
    for p in PERCENTILES:
        rounds = {name: [each[p] for each in turns] for name, turns in told.items()}
        rows += compared(f"{what}, p{p}", rounds, "µs")
    return rows


def _left_out(intervals: dict[str, list[NDArray[np.float64]]]) -> list[Measurement]:
    return [
        over_rounds(
            f"{name}, intervals left out because the emulated bus was held up",
            [100.0 * float(np.mean(held_up(turn))) for turn in each],
            "%",
        )
        for name, each in intervals.items()
    ]
