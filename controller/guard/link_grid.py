"""Lays the grid of delays, frequencies and intervals on which a link's limits are computed."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.guard.belief import Belief
from haptic_wall.controller.theory.velocity_filter import VelocityFilter

PHASE = 0.4
"""Largest step of the phase of the vibration over the delay, between frequencies of the grid and
between its delays [rad]"""
_QUICK, _QUARTER = 0.3, 0.25
"""Friction times period over the lightest motor from which delays of the grid are nearer: the limit
of a motor that settles within a period dips beside each whole period; their distance in periods"""
_CYCLES = 1.15
"""Cycles of that phase that the frequencies of one delay span at most. Within a cycle each phase
occurs, and the slowest vibration of a phase bounds the damping and the stiffness most"""
_SLOWER = 0.93
"""Fraction of a frequency down to which a coarse grid of delays counts it"""
_NOTCH = 0.25
"""Largest relative step of the interval, in widths of a notch"""


class Knot(NamedTuple):
    """A delay of the grid, and the frequencies that are counted there."""

    delay: float
    """[s]"""
    low: float
    """[Hz]"""
    high: float
    """[Hz]"""


def intervals(
    belief: Belief,
    period: float,
    served: tuple[float, float],
    velocity_filter: VelocityFilter | None,
) -> list[float]:
    """Return the intervals that stand for all from ``served[0]`` to ``served[1]`` periods [s].

    Between two of them the phase of no vibration over the interval turns by more than ``PHASE``.
    """
    low, high = served[0] * period, served[1] * period
    if low == high:
        return [period]
    hz = belief.flexible_hz
    even = math.ceil(math.tau * hz.high * (high - low) / PHASE)
    if velocity_filter is not None:
        # a filter is slower by the interval, and a notch then lies elsewhere
        even = max(even, math.ceil(velocity_filter.q * math.log(high / low) / _NOTCH))
    found: list[float] = np.linspace(low, high, even + 1).tolist()
    return found


def is_quick(belief: Belief, period: float) -> bool:
    """Whether friction stops the lightest motor within about a period."""
    return belief.damping.high * period > _QUICK * belief.lightest_motor


def delays(
    low: float, high: float, period: float, longest: float, every: bool, quick: bool
) -> list[Knot]:
    """Return the grid from 0 to above ``longest`` [s], of vibrations ``low`` to ``high`` [Hz].

    Where the frequencies span more than a cycle of the phase, or the delay is more than one, delays
    follow each other by a ratio. A vibration after a delay between two of them has the same phase
    after the longer one at a frequency that is lower by the ratio: so the frequencies are
    widened downward by it.

    Args:
        low: Least frequency [Hz].
        high: Greatest [Hz].
        period: T [s].
        longest: Delay that the grid has to reach [s].
        every: Whether all frequencies are counted at each delay.
        quick: ``is_quick``.
    """
    cycles = math.inf if every else _CYCLES
    found = [Knot(0.0, *_counted(low, high, period, 0.0, cycles))]
    while found[-1].delay <= longest + 1e-12:
        last = found[-1]
        after = last.delay + period
        # limits in proportion to 1 / (T/2 + t_d) hold to a factor of 2 at most
        step = min(last.delay + 0.5 * period, PHASE / (math.tau * last.high))
        if quick:
            step = min(step, _QUARTER * period)
        widened = (1.0 / _SLOWER - 1.0) * after
        if not every and step < widened and (last.high < high or low * after > 1.0):
            delay = last.delay + widened
            found.append(Knot(delay, *_counted(_SLOWER * low, high, period, delay, cycles)))
        else:
            delay = last.delay + step
            found.append(Knot(delay, *_counted(low, high, period, delay, cycles)))
    return found


def _counted(
    low: float, high: float, period: float, delay: float, cycles: float
) -> tuple[float, float]:
    """Return the lowest and the highest of the frequencies that matter after a delay [Hz].

    Faster ones than a cycle above the lowest meet the same phases, and bound less: both damping and
    stiffness that a vibration allows rise with its frequency.
    """
    span = cycles / (delay + 0.5 * period)
    if high <= low + span:
        return low, high
    return low, low + span
