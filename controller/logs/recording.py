"""Defines a recorded motion on an even grid of samples, and reads it from a log.

A gap splits the record, because the motion in it is unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.detection import position_step
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.walls import walls_of
from haptic_wall.controller.runtime.telemetry import FLAG_WARM_UP
from haptic_wall.hw.servo import Outcome

Floats = NDArray[np.float64]

LEAST = 10
"""Least number of samples worth analysing."""
MOST_ROWS = 4_000_000
"""Largest number of samples: more than an hour at 1 kHz"""
MOST_LAG_S = 10.0
"""Longest time between a sample and its torque [s]"""
GAP = 10
"""Periods without a sample that split the record."""


@dataclass(frozen=True, slots=True)
class Recording:
    """A motion in parts, each on one even grid; what is not known is NaN."""

    period: float
    """[s]"""
    parts: tuple[Part, ...]
    position_step: float
    """Encoder count [rad]; 0: none"""
    notes: tuple[str, ...]
    """Sentences about repaired or omitted samples"""
    inertia: float = math.nan
    """[kg·m²], per commanded torque, as the others"""
    damping: float = math.nan
    """[N·m·s/rad]"""
    coulomb: float = math.nan
    """[N·m]"""
    lag: float = math.nan
    """From a sample until its torque acts [s]"""

    @property
    def samples(self) -> int:
        """Return the number of samples of all parts."""
        return sum(part.times.size for part in self.parts)


@dataclass(frozen=True, slots=True)
class Part:
    """An uninterrupted stretch; arrays of one length."""

    times: Floats
    """[s]"""
    positions: Floats
    """[rad]; NaN where one is missing"""
    torques: Floats | None
    """Commanded at each sample [N·m]; None: not recorded"""

    def sliced(self, some: slice) -> Part:
        """Return some of the samples."""
        torques = None if self.torques is None else self.torques[some]
        return Part(self.times[some], self.positions[some], torques)


def recording_of_log(path: Path, axis: str | None = None) -> Recording:
    """Return the motion of a log while the wall was on, with the servo that its run believed in.

    Args:
        path: The log.
        axis: Name of the axis; None: there is only one.

    Raises:
        UserError: The wall was on for too short a time, or for too long; or there is no such axis.
        LogFormatError: The file is not a log of this program.
        OSError: It cannot be read, or is no regular file.
    """
    log = LogReader.open(path).axis(axis)
    held: list[tuple[NDArray[np.void], ...]] = []
    count = 0
    for block in log.blocks():
        rows = block[(block["flags"] & FLAG_WARM_UP) == 0]
        good = (rows["outcome"] == Outcome.OK) & np.isfinite(rows["position"])
        count += len(rows)
        if count > MOST_ROWS:
            break
        positions = np.where(good, rows["position"], np.nan)
        held.append((rows["deadline_ns"].copy(), positions, rows["torque"].copy(), rows["age_ns"]))
    if not LEAST <= count <= MOST_ROWS:
        raise UserError(
            f"found {count if count < LEAST else f'more than {MOST_ROWS}'} rows with the wall on",
            field="LOG",
            given=path,
            wanted=f"from {LEAST} to {MOST_ROWS}",
        )
    deadlines, positions, torques, ages = map(np.concatenate, zip(*held, strict=True))
    config = walls_of(log.metadata, ()).configs[0]
    belief, notes = config.belief(), list[str]()
    whole = Part((deadlines - deadlines[0]) * 1e-9, positions, torques)
    good = np.isfinite(positions)
    if not good.all():
        notes.append(f"{np.count_nonzero(~good)} readings failed or were late and are left out")
    age = float(np.median(ages[good])) * 1e-9 if good.any() else 0.0
    gain = belief.torque_gain.value
    parts = parted(whole, config.period_s, notes)
    return Recording(
        config.period_s,
        parts,
        position_step(positions),
        tuple(notes),
        inertia=belief.inertia.value / gain,
        damping=belief.damping.value / gain,
        coulomb=belief.coulomb.value / gain,
        lag=min(age + belief.delay.value, MOST_LAG_S),
    )


def parted(whole: Part, period: float, notes: list[str]) -> tuple[Part, ...]:
    """Split the record where samples are missing for long; add to the notes what is left out."""
    seen = np.flatnonzero(np.isfinite(whole.positions))
    breaks = np.flatnonzero(np.diff(whole.times[seen]) > GAP * period)
    if breaks.size:
        since, until = (seconds(whole.times[seen[breaks[0] + end]]) for end in (0, 1))
        more = f", and in {breaks.size - 1} more such gaps" if breaks.size > 1 else ""
        notes.append(
            f"nothing is known from {since} to {until} s{more}: the analysis restarts there"
        )
    stretches = [some for some in np.split(seen, breaks + 1) if some.size]
    short = [some for some in stretches if some.size < LEAST]
    if short:
        lost, since = sum(some.size for some in short), seconds(whole.times[short[0][0]])
        notes.append(
            f"{lost} samples in stretches that are too short, from {since} s on, are left out"
        )
    return tuple(
        whole.sliced(slice(int(some[0]), int(some[-1]) + 1))
        for some in stretches
        if some.size >= LEAST
    )


def seconds(moment_s: float) -> str:
    """Format a moment [s] for a sentence, to a tenth of a millisecond."""
    return f"{round(float(moment_s), 4):.14g}"
