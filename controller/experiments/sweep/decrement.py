"""Measures the growth or decay of an oscillation from one turning point to the next, from samples.

Turning points lie between samples and between encoder counts, so each is fitted: a constant and a
sinusoid of the local frequency, over the samples around it. The constant absorbs the offset of the
oscillation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.theory.checks import FloatArray

_WINDOW = 1.0 / 3.0
"""Half width of a fit in half periods: ±60 degrees."""
_LEAST_SAMPLES = 2
"""Least number on either side of a turning point: in total two more than fitted values."""
_SETTLING, _SETTLED = 1.0 / 3.0, 5
"""Fraction of the turning points omitted at the start, and their largest number: the release
excites other modes too."""


@dataclass(frozen=True, slots=True)
class Turns:
    """Turning points in order of time; the first is the start, at rest."""

    time: FloatArray
    """Shape (n,) [s]"""
    position: FloatArray
    """Shape (n,) [rad]"""

    @property
    def half_period(self) -> float:
        """Return the median time between two of them [s]; NaN with fewer than three."""
        return float(np.median(np.diff(self.time[1:]))) if self.time.size > 2 else float("nan")


@dataclass(frozen=True, slots=True)
class Growth:
    """Growth of the amplitude from each turning point to the next."""

    log_ratio: FloatArray
    """Logarithm of the ratio of successive amplitudes, shape (n,)"""
    amplitude: FloatArray
    """Geometric mean of the two [rad]"""


def turning_points(time: FloatArray, position: FloatArray, least: float) -> Turns:
    """Find the turning points of a motion that starts at rest.

    Args:
        time: Time of the samples, increasing, gaps allowed, shape (n,) [s].
        position: Shape (n,) [rad].
        least: Smaller reversals are noise [rad].

    Returns:
        The start and every turning point confirmed by a return of ``least``.
    """
    if time.size == 0:
        return Turns(np.empty(0), np.empty(0))
    found = reversals(position, least)
    rough = np.concatenate([time[:1], [0.5 * (time[a] + time[b]) for a, b in found]])
    where = np.concatenate([position[:1], [position[a] for a, _ in found]])
    fitted_time, fitted = rough.copy(), where.copy()
    for _ in range(2):  # repeated with the better instants, which give the frequency
        for n in range(1, rough.size):
            spacing = _spacing(fitted_time, n)
            fitted_time[n], fitted[n] = _fit(time, position, rough[n], spacing, where[n])
    return Turns(fitted_time, fitted)


def growth(turns: Turns, sound: NDArray[np.bool_]) -> Growth:
    """Return the growth per half-cycle, of the oscillation alone.

    The amplitude at a turning point is half its distance from the mean of its neighbours: an offset
    or a creep of the oscillation cancels.

    Args:
        turns: n of them.
        sound: Whether the motion between each and the next can be used, shape (n - 1,).
    """
    x = turns.position
    if x.size < 4:
        return Growth(np.empty(0), np.empty(0))
    amplitude = 0.5 * np.abs(x[1:-1] - 0.5 * (x[:-2] + x[2:]))
    first = min(int(_SETTLING * x.size), _SETTLED) - 1
    number = np.arange(first, amplitude.size - 1)
    good = sound[number] & sound[number + 1] & sound[number + 2]
    good &= (amplitude[number] > 0.0) & (amplitude[number + 1] > 0.0)
    number = number[good]
    before, after = amplitude[number], amplitude[number + 1]
    return Growth(np.log(after / before), np.sqrt(before * after))


def reversals(position: FloatArray, least: float) -> list[tuple[int, int]]:
    """Return first and last sample of each extreme from which the motion returned by ``least``."""
    found: list[tuple[int, int]] = []
    start = position[0]
    direction = 0.0
    best, first, last = start, 0, 0
    for i, x in enumerate(position.tolist()):
        if direction == 0.0:
            if abs(x - start) >= least:
                direction = 1.0 if x > start else -1.0
                best, first, last = x, i, i
        elif (x - best) * direction > 0.0:
            best, first, last = x, i, i
        elif x == best:
            last = i
        elif (best - x) * direction >= least:
            found.append((first, last))
            direction = -direction
            best, first, last = x, i, i
    return found


def _spacing(time: FloatArray, n: int) -> float:
    """Return the half period about a turning point [s]; the first one is longer."""
    neighbours = time[max(1, n - 1) : n + 2]
    if neighbours.size < 2:
        return float(time[n] - time[n - 1])
    return float((neighbours[-1] - neighbours[0]) / (neighbours.size - 1))


def _fit(
    time: FloatArray, position: FloatArray, rough: float, spacing: float, extreme: float
) -> tuple[float, float]:
    """Return instant and position of one turning point."""
    centre = int(np.searchsorted(time, rough))
    low = int(np.searchsorted(time, rough - _WINDOW * spacing))
    high = int(np.searchsorted(time, rough + _WINDOW * spacing, side="right"))
    low, high = min(low, centre - _LEAST_SAMPLES), max(high, centre + _LEAST_SAMPLES + 1)
    low, high = max(low, 0), min(high, time.size)
    s = (time[low:high] - rough) * (np.pi / spacing)
    if s.size < 2 * _LEAST_SAMPLES:
        return rough, extreme
    basis = np.column_stack([np.ones_like(s), np.cos(s), np.sin(s)])
    (offset, a, b), *_ = np.linalg.lstsq(basis, position[low:high], rcond=None)
    size = float(np.hypot(a, b))
    side = 1.0 if a > 0.0 else -1.0
    shift = float(np.arctan2(side * b, side * a)) * spacing / np.pi
    return rough + shift, float(offset + side * size)
