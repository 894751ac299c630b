"""Velocity estimators on sampled positions: the backward difference and its N-sample form."""

from __future__ import annotations

from typing import Final, Protocol

SHORTEST: Final = 0.5
"""The shortest time that a velocity spans [periods]: over a very short one, after a late tick, one
encoder count would give a high speed. A shorter interval counts with the one before: divided by
more than has passed, the velocity would be too low while a late tick's torque is held longest."""


class VelocityEstimator(Protocol):
    """Estimates the velocity from positions that arrive once a period, some of them missing."""

    def update(self, position: float, periods: float) -> float:
        """Return the velocity [rad/s] at a new position [rad], ``periods`` after the last good one.

        ``periods`` is at least 0 and need not be whole: a tick may be late. The first call has no
        history and returns 0.
        """
        ...


class BackwardDifference:
    """Computes ``(x[k] - x[k-1]) / T``: the estimator that the stability theory assumes.

    After lost readings it divides the difference by the periods that really passed; after less than
    ``SHORTEST`` it is ``(x[k] - x[k-2])`` over both intervals.

    Args:
        period: Sampling period T [s].
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._last: float | None = None
        self._before: float | None = None
        self._periods = 0.0  # between these two

    def update(self, position: float, periods: float) -> float:
        """Return the velocity; see ``VelocityEstimator``."""
        first, last, span = self._before, self._last, periods
        if last is None:
            self._last = position
            return 0.0
        if periods >= SHORTEST or first is None:
            first = last
        else:
            span += self._periods
        self._before, self._last, self._periods = last, position, periods
        return (position - first) / (max(span, SHORTEST) * self._period)


class SampleDifference:
    """Computes ``(x[k] - x[k-N]) / (N T)``: a finer velocity step, for (N-1)/2 periods more lag.

    While fewer than N periods are known it uses the known ones.

    Args:
        period: Sampling period T [s].
        samples: N, at least 1.
    """

    def __init__(self, period: float, samples: int) -> None:
        self._period = period
        self._samples = samples
        self._index = 0.0
        self._history: list[tuple[float, float]] = []

    def update(self, position: float, periods: float) -> float:
        """Return the velocity; see ``VelocityEstimator``."""
        self._index += periods
        history = self._history
        history.append((self._index, position))
        # Keep, of the positions at least N periods old, only the youngest.
        while len(history) > 2 and history[1][0] <= self._index - self._samples:
            del history[0]
        index, oldest = history[0]
        if index == self._index:
            return 0.0
        return (position - oldest) / (max(self._index - index, SHORTEST) * self._period)


class Biquad:
    """Filters the velocity that damps, by ``y = b0 v + b1 v' + b2 v'' - a1 y' - a2 y''``.

    A tick is a step, however long: a slower loop has a slower filter, as the guard assumes.

    Args:
        taps: b0, b1, b2, a1, a2; see ``theory.velocity_filter``.
    """

    __slots__ = ("_first", "_second", "_taps")

    def __init__(self, taps: tuple[float, float, float, float, float]) -> None:
        self._taps = taps
        self._first = self._second = 0.0

    def update(self, velocity: float) -> float:
        """Return the filtered velocity [rad/s]; call once for each new sample."""
        b0, b1, b2, a1, a2 = self._taps
        found = b0 * velocity + self._first
        self._first = b1 * velocity - a1 * found + self._second
        self._second = b2 * velocity - a2 * found
        return found


def velocity_estimator(period: float, samples: int) -> VelocityEstimator:
    """Return the estimator over ``samples`` periods [1] of ``period`` [s]."""
    return BackwardDifference(period) if samples == 1 else SampleDifference(period, samples)
