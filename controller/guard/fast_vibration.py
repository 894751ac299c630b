"""Bounds the limits of a load that vibrates near half the rate and above, by formulas.

They bound damping ceiling and limit from below at any delay, and take the place of the grid of
``flexible``. ``scripts/study guard`` searches for truths that its walls make vibrate.
"""

from __future__ import annotations

import math

import numpy as np

from haptic_wall.controller.guard.belief import Belief, motor_side
from haptic_wall.controller.theory.checks import FloatArray

UNBOUND = 1e12
"""Stands for no limit at all [N·m/rad]"""
_BY_FORMULA = 0.45
"""Cycles per period from which formulas count a vibration. About half a cycle one that is hardly
damped bounds the damping most on one side, and hardly on the other: no grid finds that"""
_FAST_CEILING, _FAST_COST = 0.75, 0.1
"""Fraction of a fast vibration's ceiling, or of the rigid one, that is used; fraction of the rigid
limit that it costs at its ceiling at most"""
_DAMPER, _SPRING, _FRICTION = 0.2, 0.12, 0.12
"""Rates of a damper, a spring and the motor's friction up to which formulas hold, over that of the
vibration"""
_COSTS, _APART = 0.9, 1.26
"""Fraction of the rigid limit that a formula must leave to take the place of the grid; ratio of the
frequencies that are tried: walls of different damping share a grid"""


def formulas_from(
    belief: Belief, stiffness: FloatArray, damping: FloatArray, periods: tuple[float, float]
) -> float:
    """Return the frequency from which formulas count the vibration [Hz].

    They do near half a cycle per period and above, and where they hardly cost anything.

    Args:
        belief: Belief with a load behind a transmission.
        stiffness: Exact limit of the rigid servo, of each plant [N·m/rad].
        damping: Largest that is commanded to each [N·m·s/rad].
        periods: Shortest and longest [s].
    """
    low, highest = belief.flexible_hz.low, _BY_FORMULA / periods[1]
    if low >= highest or belief.encoder != "output":
        return highest
    rigid = np.full_like(damping, UNBOUND)
    steps = math.ceil(math.log(highest / low) / math.log(_APART))
    for hz in (low, *(highest / _APART**k for k in range(steps - 1, 0, -1))):
        allowed = fast_ceiling(belief, hz, rigid, periods[0])
        if np.all(damping < _FAST_CEILING * allowed):
            left = fast_limit(belief, hz, stiffness, damping / allowed, periods[0])
            if np.all(left >= _COSTS * stiffness):
                return hz
    return highest


def fast_ceiling(belief: Belief, hz: float, rigid: FloatArray, period: float) -> FloatArray:
    """Return a bound of the ceiling for a vibration that is far faster than the wall's motion.

    A torque that is held for a period moves the vibration by at most ``2 s / (omega² J)`` of it,
    with ``s = sin(omega T / 2)``, and the difference of two samples over the period is at most
    ``2 s / T`` of the amplitude. So the damper adds at most ``4 s² B / (omega² J T)`` of the
    amplitude in a period, at any delay; the vibration loses ``1 - exp(-zeta omega T)``.

    Args:
        belief: Belief with a load behind a transmission.
        hz: Least frequency of the vibration [Hz].
        rigid: Ceiling of each plant without the vibration, in commanded units [N·m·s/rad].
        period: The shortest [s].
    """
    rate, inertia = math.tau * hz, _moved(belief)
    if not _follows(belief, rate):
        return np.zeros_like(rigid)
    lost = -math.expm1(-belief.flexible_damping_ratio.low * rate * period)
    swing = math.sin(min(0.5 * rate * period, 0.5 * math.pi)) ** 2
    damped = min(lost * rate**2 * inertia * period / (4.0 * swing), _DAMPER * rate * inertia)
    found: FloatArray = _FAST_CEILING * np.minimum(rigid, damped / belief.torque_gain.high)
    return found


def fast_limit(
    belief: Belief, hz: float, exact: FloatArray, of_ceiling: FloatArray, period: float
) -> FloatArray:
    """Return the limit for such a load, from the rigid servo's exact limit [N·m/rad].

    The wall's spring also feeds the vibration, by at most ``K / (omega² J)`` a period, of which its
    damping takes up ``zeta omega T``. That binds only where the vibration is hardly damped.

    Args:
        belief: Belief with a load behind a transmission.
        hz: Least frequency of the vibration [Hz].
        exact: That limit of each plant [N·m/rad].
        of_ceiling: Virtual damping over ``fast_ceiling``.
        period: The shortest [s].
    """
    left = 1.0 - np.clip(of_ceiling, 0.0, 1.0)
    rate, ratio = math.tau * hz, belief.flexible_damping_ratio.low
    soft = rate**2 * _moved(belief) / belief.torque_gain.high
    by_spring = np.minimum(_FAST_CEILING * left * ratio * rate * period, _SPRING**2) * soft
    if not _follows(belief, rate):
        return np.zeros_like(exact)
    found: FloatArray = np.minimum(exact * (1.0 - _FAST_COST * (1.0 - left)), by_spring)
    return found


def _moved(belief: Belief) -> float:
    """Return the inertia that a torque moves, as the encoder sees the vibration [kg·m²]."""
    inertia, load = belief.inertia.low, belief.load_inertia.high
    if belief.encoder == "output" or belief.bare:
        return inertia
    return inertia * min(1.0, motor_side(inertia, load) / load)


def _follows(belief: Belief, rate: float) -> bool:
    """Whether the lightest motor follows a vibration [rad/s], and friction does not hold it."""
    return belief.damping.high <= _FRICTION * rate * belief.lightest_motor
