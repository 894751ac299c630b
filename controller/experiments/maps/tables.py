"""Tabulates a law without a memory: its elongation over position, linear between rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.laws.own import Instants
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

    def __post_init__(self) -> None:
        """Check the rows, which compiled code does not.

        Raises:
            ValueError: The table cannot be searched.
        """
        x, rows = self.positions, self.positions.size
        if rows < 2 or self.elongations.shape != x.shape or not np.all(x[1:] > x[:-1]):
            raise ValueError("a table has two or more rising positions, each with its elongation")

    @classmethod
    def of(cls, shape: Shape, positions: FloatArray) -> Table:
        """Tabulate a shape at these positions [rad].

        Raises:
            ValueError: It depends on more than the position, as friction and texture do, or the
                positions do not rise.
        """
        places = positions.tolist()
        elongations = [shape.elongation(position, 0.0, 1.0) for position in places]
        for position, elongation in zip(places, elongations, strict=True):
            shape.settle(position)
            others = {shape.elongation(position, speed, 2.0) for speed in (1e9, -1e9)}
            if others != {elongation} or isinstance(shape, Instants):
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
