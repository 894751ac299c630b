"""Computes a servo's stiffness limits over the virtual damping: a function for other programs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.guard.boundary_curve import (
    Question,
    ceiling,
    curve,
    default_dampings,
    highest,
)
from haptic_wall.controller.guard.types import Situation
from haptic_wall.controller.theory.checks import FloatArray

Span = float | tuple[float, float]
"""A number, or (low, high) where it is known only within a range"""


@dataclass(frozen=True, slots=True)
class Boundary:
    """Limits over the virtual damping; arrays of one length, NaN where a limit does not apply.

    The names are those of ``haptic-wall boundary --json``.
    """

    virtual_damping: FloatArray
    """[N·m·s/rad]"""
    linear: FloatArray
    """Sum of the damping over sum of the delay [N·m/rad]"""
    exact: FloatArray
    """Below it a two-sided wall is stable; 0 where no stiffness is [N·m/rad]"""
    one_sided: FloatArray
    """Below it a wall that never pulls returns no device faster than it came [N·m/rad]"""
    passive: FloatArray
    """Below it the wall is stable with any passive hand [N·m/rad]"""
    frequency_hz: FloatArray
    """Frequency of the oscillation at the exact limit [Hz]"""
    max_virtual_damping: float
    """Above it no stiffness is stable [N·m·s/rad]"""
    peak_stiffness: float
    """The highest exact limit at any virtual damping [N·m/rad]"""
    peak_virtual_damping: float
    """The virtual damping there [N·m·s/rad]"""


def boundary(
    *,
    inertia: Span,
    damping: Span,
    period: float,
    delay: Span,
    virtual_damping: Sequence[float] | FloatArray | None = None,
    torque_gain: Span = 1.0,
    velocity_samples: int = 1,
) -> Boundary:
    """Compute the stiffness limits of a wall on a servo; with ranges, at their least safe corner.

    Args:
        inertia: Of all that the servo turns [kg·m²].
        damping: Viscous friction b [N·m·s/rad].
        period: Sampling period T [s].
        delay: The whole delay from a sample to its torque [s].
        virtual_damping: B of each point [N·m·s/rad]; None: fractions of the ceiling.
        torque_gain: Acting torque over commanded torque [1].
        velocity_samples: Samples over which the velocity is the difference.

    Raises:
        UserError: A value lies outside its domain; the message names it.
    """
    if not 0.0 < period < math.inf:
        raise UserError(f"found {period:g}", field="period", wanted="a time above 0 s")
    if velocity_samples < 1:
        raise UserError(f"found {velocity_samples}", field="velocity_samples", wanted="1 or more")
    whole = _span("delay", delay, zero=True)
    belief = Belief(
        inertia=_span("inertia", inertia, zero=False),
        damping=_span("damping", damping, zero=True),
        coulomb=Bounded.exactly(0.0),
        delay=whole,
        torque_gain=_span("torque_gain", torque_gain, zero=False),
    )
    question = Question(
        situation=Situation(belief, period, 1.0, 0.0),
        velocity_samples=velocity_samples,
    )
    try:
        chosen = default_dampings(question) if virtual_damping is None else virtual_damping
        found = curve(question, chosen)
        top = highest(question)
        limits = found.found.limits
        unknown = np.full(found.virtual_damping.size, np.nan)
        return Boundary(
            virtual_damping=found.virtual_damping,
            linear=limits["linear"],
            exact=limits["exact"],
            one_sided=limits.get("one_sided", unknown),
            passive=found.passive,
            frequency_hz=found.frequency,
            max_virtual_damping=ceiling(question),
            peak_stiffness=top["stiffness"],
            peak_virtual_damping=top["virtual_damping"],
        )
    except ValueError as error:  # numbers so extreme that only the theory can tell
        raise UserError(error, advice="check that all values are in SI units") from None


def _span(name: str, given: Span, *, zero: bool) -> Bounded:
    low, high = given if isinstance(given, tuple) else (given, given)
    least = "0 or more" if zero else "more than 0"
    if not (low >= 0.0 if zero else low > 0.0) or not low <= high < math.inf:
        raise UserError(
            f"found {low:g}" if low == high else f"found {low:g} to {high:g}",
            field=name,
            wanted=f"{least}, a number or (low, high), in SI units",
        )
    return Bounded(0.5 * (low + high), low, high)
