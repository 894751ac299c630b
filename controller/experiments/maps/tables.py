"""Tabulates a law without a memory: its elongation over position, linear between rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.laws.shape import Shape
from haptic_wall.controller.theory.checks import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Table:
    """A law for many loops; see ``haptic_wall.controller.laws.shape``."""

    positions: FloatArray
    """Rising, two or more; beyond the ends the elongation stays [rad]"""
    elongations: FloatArray
    """One for each [rad]"""
    everywhere: bool = True
    """Damping acts at every position; otherwise in contact only, and the law never pulls"""

    @classmethod
    def of(cls, shape: Shape, positions: FloatArray) -> Table:
        """Tabulate a shape at these positions [rad].

        Raises:
            ValueError: It depends on more than the position, as friction and texture do.
        """
        elongations = [shape.elongation(position, 0.0, 1.0) for position in positions.tolist()]
        again = [shape.elongation(position, 1e9, 2.0) for position in positions[::-1].tolist()]
        if again[::-1] != elongations:
            raise ValueError("the shape depends on more than the position")
        return cls(positions, np.array(elongations), shape.damped_everywhere)

    def take(self, index: IntArray | slice) -> Table:  # noqa: ARG002 - as all parts of walls
        """Return the law: all walls have it."""
        return self

    def elongation(self, position: FloatArray) -> FloatArray:
        """Return the elongation at each position [rad]."""
        x, e = self.positions, self.elongations
        i = np.clip(np.searchsorted(x, position, side="right"), 1, x.size - 1)
        low, first = x[i - 1], e[i - 1]
        between = first + (e[i] - first) * (position - low) / (x[i] - low)
        between = np.where(position <= x[0], e[0], between)
        result: FloatArray = np.where(position >= x[-1], e[-1], between)
        return result
