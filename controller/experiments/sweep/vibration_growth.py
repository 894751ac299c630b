"""Fits the growth rate of a vibration while the shaft cruises: polynomial plus growing sinusoid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.theory.checks import FloatArray

_DEGREE = 5
_SETTLED_S = 0.015
"""Left out at the beginning [s]"""
_FEWEST = 60
"""Samples of a cruise"""
_LOWEST_HZ, _HIGHEST_HZ = 6.0, 250.0
_PER_OCTAVE = 16
_GROWTHS = (-30.0, -8.0, 0.0, 8.0, 30.0)
"""Tried growths [1/s]"""
_SEEN = 1.08
"""Squares without a ringing over those with it, from which it is seen"""
_AWAY = 0.15
"""Largest relative distance from the expected frequency"""
_CORRELATED = 3.0
"""Standard error over that of independent errors"""
_BACK = 3.0
"""Way back that is more than rounding, in counts"""


@dataclass(frozen=True, slots=True)
class Growing:
    """A vibration that grows, or decays."""

    per_s: float
    """Growth rate of the amplitude [1/s]"""
    stderr: float
    hertz: float


class Cruised:
    """One cruise: its times, and its positions without a polynomial.

    Args:
        time: [s].
        position: [rad].
        way: Direction, 1.0 or -1.0; samples after a reversal are left out.
        count: Count of the encoder [rad]; 0: none.
    """

    def __init__(self, time: FloatArray, position: FloatArray, way: float, count: float) -> None:
        ahead = way * position
        back = np.maximum.accumulate(ahead) - ahead if ahead.size else ahead
        turned = np.flatnonzero(back > max(_BACK * count, 1e-3))
        kept = (time >= _SETTLED_S) & (np.arange(time.size) < (turned[:1].tolist() or [1 << 30])[0])
        self.time: FloatArray = time[kept] - _SETTLED_S
        span = float(self.time[-1]) if self.time.size >= _FEWEST else 1.0
        basis = np.polynomial.legendre.legvander(2.0 * self.time / span - 1.0, _DEGREE)
        self.usable = self.time.size >= _FEWEST
        self._basis = np.linalg.qr(basis)[0] if self.usable else basis
        self._left = self._without(position[kept][:, None])[:, 0] if self.usable else position[:0]

    def squares(self, hertz: float | None, growth: float) -> float:
        """Return the sum of squared residuals beside a polynomial and a ringing [rad²]."""
        left = self._left
        square = float(left @ left)
        if hertz is None:
            return square
        # At most 1 during the cruise, whichever way it grows.
        since = self.time - (self.time[-1] if growth > 0.0 else 0.0)
        ringing = np.exp(complex(growth, math.tau * hertz) * since)
        columns = self._without(np.column_stack([ringing.real, ringing.imag]))
        normal, right = columns.T @ columns, columns.T @ left
        normal[np.diag_indices(2)] += 1e-9 * np.trace(normal)
        explained = np.dot(right, np.linalg.solve(normal, right))
        return square - float(np.asarray(explained))

    def _without(self, columns: FloatArray) -> FloatArray:
        found: FloatArray = columns - self._basis @ (self._basis.T @ columns)
        return found


def ringing_hz(cruises: Sequence[Cruised]) -> float:
    """Return the frequency at which cruises together ring most [Hz]."""
    kept = [each for each in cruises if each.usable]
    count = round(_PER_OCTAVE * math.log2(_HIGHEST_HZ / _LOWEST_HZ)) + 1
    best = (math.inf, _LOWEST_HZ)
    for hertz in np.geomspace(_LOWEST_HZ, _HIGHEST_HZ, count).tolist():
        best = min(best, (min(_squares(kept, hertz, growth) for growth in _GROWTHS), hertz))
    return best[1]


def growth_of(cruises: Sequence[Cruised], expected_hz: float) -> Growing | None:
    """Return the growth of the ringing near a frequency; None: it is not to be seen.

    Args:
        cruises: Under one damping.
        expected_hz: [Hz]
    """
    from scipy.optimize import minimize

    kept = [each for each in cruises if each.usable]
    without = _squares(kept, None, 0.0)
    if without <= 0.0:
        return None

    def cost(point: FloatArray) -> float:
        away = float(np.clip(point[0], -_AWAY, _AWAY))
        return _squares(kept, expected_hz * (1.0 + away), 10.0 * float(point[1])) / without

    away = (-0.12, -0.08, -0.04, 0.0, 0.04, 0.08, 0.12)
    begun = min((cost(np.array([f, g / 10.0])), f, g / 10.0) for f in away for g in _GROWTHS)
    at = np.array(begun[1:])
    simplex = at + np.array([[0.0, 0.0], [0.02, 0.0], [0.0, 0.4]])
    options = {"initial_simplex": simplex, "xatol": 1e-4, "fatol": 1e-7, "maxfev": 120}
    found = minimize(cost, at, method="Nelder-Mead", options=options)
    least = float(found.fun)
    if least * _SEEN > 1.0:
        return None
    step = 0.05
    up, down = (cost(found.x + np.array([0.0, sign * step])) for sign in (1.0, -1.0))
    bend = max((up + down - 2.0 * least) / step**2, 1e-12)
    samples = sum(each.time.size for each in kept)
    stderr = 10.0 * _CORRELATED * math.sqrt(2.0 * least / samples / bend)
    hertz = expected_hz * (1.0 + float(np.clip(found.x[0], -_AWAY, _AWAY)))
    return Growing(10.0 * float(found.x[1]), stderr, hertz)


def _squares(cruises: Sequence[Cruised], hertz: float | None, growth: float) -> float:
    return sum(each.squares(hertz, growth) for each in cruises)
