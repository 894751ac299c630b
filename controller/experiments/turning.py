"""How a motion grows or shrinks, told by its turning points: their amplitudes, fitted over time."""

from __future__ import annotations

import numpy as np

from controller.experiments.many_walls import Loops
from controller.theory.checks import FloatArray, IntArray

_SETTLING = 2
"""Turning points left out at the start: what the release excites beside the oscillation."""


class Turnings:
    """Watches a block of loops; the logarithms of the amplitudes are fitted by straight lines.

    The amplitude of a turning point is its distance from the wall, from the velocities before and
    after it: exact for a light body under one held torque.

    Attributes:
        count: Turning points seen.
        least, greatest: Amplitudes, those left out at the start aside [rad]; inf and 0 before.
        last_saturated: Period in which the torque was limited last; -1: never.
    """

    def __init__(self, loops: Loops, period: FloatArray) -> None:
        n = period.size
        self._loops = loops
        self._period = period
        self._before = loops.bodies.velocity.copy()
        self._position = loops.bodies.position.copy()
        self._turned = np.empty(n, dtype=np.bool_)
        self._product = np.empty(n)
        self._seen: list[tuple[IntArray, FloatArray, FloatArray, FloatArray]] = []
        self._when: list[int] = []
        self._sums = np.zeros((5, n))
        self.count = np.zeros(n, dtype=np.int64)
        self.least = np.full(n, np.inf)
        self.greatest = np.zeros(n)
        self.last_saturated = np.full(n, -1, dtype=np.int64)

    def watch(self) -> None:
        """Look at the period that has just passed."""
        loops, before = self._loops, self._before
        position, velocity = loops.bodies.position, loops.bodies.velocity
        np.multiply(before, velocity, self._product)
        np.less(self._product, 0.0, self._turned)
        index = self._turned.nonzero()[0]
        if index.size:
            self._seen.append((index, before[index], velocity[index], self._position[index]))
            self._when.append(loops.k)
        if loops.saturated is not None:
            self.last_saturated[loops.saturated] = loops.k
        # A body at rest between two moves keeps the velocity with which it came.
        np.not_equal(velocity, 0.0, self._turned)
        np.copyto(before, velocity, where=self._turned)
        np.copyto(self._position, position)

    def gather(self) -> None:
        """Take the turning points seen since the last time into account."""
        if not self._seen:
            return
        index, before, after, position = (
            np.concatenate(arrays) for arrays in zip(*self._seen, strict=True)
        )
        when = np.repeat(np.array(self._when, float), [seen[0].size for seen in self._seen])
        self._seen.clear()
        self._when.clear()
        # How often each body had turned before: in order of time among those of one body.
        order = np.argsort(index, kind="stable")
        index = index[order]
        new = np.bincount(index, minlength=self.count.size)
        first = np.cumsum(new) - new
        number = self.count[index] + np.arange(index.size) - first[index]
        self.count += new
        order, index = order[number >= _SETTLING], index[number >= _SETTLING]
        before, after, t = before[order], after[order], when[order]
        moved = 0.5 * self._period[index] * before * before / (before - after)
        amplitude = np.abs(position[order] + moved)
        amplitude = np.maximum(amplitude, np.finfo(np.float64).tiny)
        y = np.log(amplitude)
        for total, value in zip(self._sums, (np.ones_like(t), t, t * t, y, t * y), strict=True):
            total += np.bincount(index, value, minlength=total.size)
        np.minimum.at(self.least, index, amplitude)
        np.maximum.at(self.greatest, index, amplitude)

    def slope(self) -> FloatArray:
        """Growth of the amplitude's logarithm per period; NaN with fewer than 3 points."""
        n, t, tt, y, ty = self._sums
        spread = n * tt - t * t
        usable = (n > 2) & (spread > 0)
        return np.where(usable, (n * ty - t * y) / np.where(usable, spread, 1.0), np.nan)
