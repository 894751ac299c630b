"""Renders a texture: a sinusoidal grating over position."""

from __future__ import annotations

import math

from haptic_wall.controller.laws.shape import Grid, LawError, Shape

PERIOD_COUNTS = 8.0
"""Least period of a grating [encoder counts]"""
FULL_TICKS = 8.0
"""Ticks in a grating period from which it is rendered in full; with half as many it is zero"""


class Texture(Shape):
    """A sinusoidal elongation, faded out at speeds at which the ticks do not resolve it.

    Args:
        period: Length of a period of the grating [rad].
        tick: Sampling period [s].
    """

    lowest_slope, highest_slope = -1.0, 1.0
    stores_work = False

    def __init__(self, period: float, tick: float) -> None:
        self._wave = math.tau / period
        self._amplitude = 1.0 / self._wave
        self._full = period / (FULL_TICKS * tick)

    def elongation(self, away: float, speed: float, stiffness: float) -> float:  # noqa: ARG002
        """Return the grating's elongation at this position and speed [rad]."""
        fade = 2.0 - abs(speed) / self._full
        if fade <= 0.0:
            return 0.0
        value = self._amplitude * math.sin(self._wave * away)
        return value if fade >= 1.0 else fade * value

    def potential(self, away: float) -> float:
        """Return the potential of the grating at full amplitude [rad²]."""
        return self._amplitude * self._amplitude * (1.0 - math.cos(self._wave * away))


def make(grid: Grid, period: float) -> Shape:
    """Make a grating of the length ``wall.period`` [rad].

    Raises:
        LawError: The encoder does not resolve it.
    """
    if period < PERIOD_COUNTS * grid.step:
        raise LawError(
            "period",
            f"found {period:.4g} rad",
            f"at least {PERIOD_COUNTS:g} encoder counts, {PERIOD_COUNTS * grid.step:.4g} rad",
        )
    return Texture(period, grid.period)
