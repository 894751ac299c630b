"""Runs on an emulated bus, judged by its record: the true delay, the grid, how a motion grows."""

import math
from pathlib import Path

import numpy as np

from haptic_wall.controller.bench.loops import FORGIVING
from haptic_wall.controller.emulated_bus.record import read_rows
from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.hw.dynamixel.codec import Instruction
from scripts.whole_program import wall_run, with_sets

INERTIA, DAMPING, VIRTUAL_DAMPING, PERIOD = 0.011951, 0.011692, 0.02, 1e-3


def witnessed(folder: Path, seconds: float, factor: float | None, delay: float) -> dict[str, float]:
    """One run judged by the witness: grid, true delay, growth of the true motion."""
    stiffness = 0.0
    if factor is not None:
        stiffness = factor * limit(delay)
    record = folder / "witness.csv"
    report = wall_run(
        folder,
        "emulated-ideal",
        f"--duration={seconds}",
        f"--witness={record}",
        *with_sets(
            (
                *FORGIVING,
                "guard.mode=off",
                "wall.side=both",
                f"wall.stiffness={stiffness}",
                f"wall.damping={VIRTUAL_DAMPING if factor else 0.0}",
                "servo.kick=0.04",
                "servo.hand=none",
                "servo.coulomb=0",
                f"servo.inertia={INERTIA}",
                f"servo.damping={DAMPING}",
                "servo.torque_limit=6",
            )
        ),
        may_oscillate=True,
    )
    samples, torques, motion = read_witness(record)
    following = np.searchsorted(torques, samples)
    paired = following < torques.size
    true_delay = torques[following[paired]] - samples[paired]
    true_delay = true_delay[true_delay < 2 * PERIOD]
    half = true_delay[true_delay.size // 5 :]
    index = np.round((samples - samples[0]) / PERIOD)
    steady = slice(samples.size // 10, None)
    period = earliest_slope(index[steady], samples[steady])
    return {
        "reported_ms": report["delay_s"]["total"] * 1e3,
        "true_p50_ms": float(np.median(half)) * 1e3,
        "true_p90_ms": float(np.percentile(half, 90)) * 1e3,
        "ppm": (period / PERIOD - 1) * 1e6,
        "factor": stiffness / limit(report["delay_s"]["total"]),
        "growth": growth(*motion) if factor else 0.0,
    }


def earliest_slope(x: np.ndarray, y: np.ndarray) -> float:
    """Slope of a line under points that come late at times, and by half a period seem early."""
    for _ in range(3):
        rest = y - np.polyval(np.polyfit(x, y, 1), x)
        keep = np.abs(rest - np.median(rest)) < 0.05 * PERIOD
        x, y, rest = x[keep], y[keep], rest[keep]
    first = [part[np.argmin(rest[part])] for part in np.array_split(np.arange(x.size), 40)]
    return float(np.polyfit(x[first], y[first], 1)[0])


def limit(delay: float) -> float:
    """Exact critical stiffness of the emulated servo at a total delay [N·m/rad]."""
    return float(critical_stiffness(INERTIA, DAMPING, VIRTUAL_DAMPING, PERIOD, delay))


def read_witness(path: Path) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Instants of the cyclic reads and of the torques [s], and the true motion."""
    rows = read_rows(path)
    states = [row for row in rows if row.event == "state"]
    samples, torques = (
        np.array([row.time_s for row in rows if row.event == "rx" and row.instruction == wanted])
        for wanted in (Instruction.READ, Instruction.SYNC_WRITE)
    )
    # The cycles begin with the first torque that is followed by others every period.
    first = torques[np.argmax(np.diff(torques, append=np.inf) < 3 * PERIOD)]
    samples = samples[(samples > first) & (samples < torques[-1])]
    under_wall = [row for row in states if row.time_s < samples[-1]]
    motion = (
        np.array([row.time_s for row in under_wall]),
        np.array([row.position_rad for row in under_wall]),
    )
    return samples, torques, motion


def growth(times: np.ndarray, positions: np.ndarray) -> float:
    """Growth rate of the oscillation [1/s]: the slope of the logarithm of its turning points.

    NaN where a stall of the machine ended the run before there were any.
    """
    moving = np.flatnonzero(np.abs(positions - positions[0]) > 0.02)
    times, positions = times[moving[0] : -50], positions[moving[0] : -50]
    offset = positions - math.pi if abs(np.mean(positions)) > 1 else positions
    turns = np.flatnonzero(np.diff(np.sign(np.diff(offset))) != 0) + 1
    heights = np.abs(offset[turns])
    keep = heights > 0.25 * np.median(heights)
    if np.count_nonzero(keep) < 3:
        return math.nan
    return float(np.polyfit(times[turns[keep]], np.log(heights[keep]), 1)[0])
