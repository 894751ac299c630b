"""Limits of a servo and its loop as functions of the virtual damping (``haptic-wall boundary``)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from haptic_wall.controller.guard.delay_parts import DelayParts
from haptic_wall.controller.guard.limits import (
    PlantLimits,
    damping_ceiling,
    evaluate_box,
    passive_over_delays,
    quantisation_limit,
)
from haptic_wall.controller.guard.plants import Plants
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from haptic_wall.controller.theory import (
    CriticalPoint,
    critical_point,
    flexible_boundary,
    flexible_ceiling,
    linear_limit,
    peak,
)
from haptic_wall.controller.theory.chain import two_masses
from haptic_wall.controller.theory.chain_contact import one_sided_limits
from haptic_wall.controller.theory.checks import FloatArray

WallSide = Literal["one", "both"]

EVERY_DAMPING = GuardSettings(mode="off")
"""Guard settings that evaluate every damping as asked, without clamping it."""
_PEAK_POINTS, _PEAK_WIDTH = 33, 1e-6
_DEFAULT_SHARES = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9)


@dataclass(frozen=True, slots=True)
class Load:
    """What the servo's motor side turns through a transmission that gives."""

    inertia: float
    """[kg·m²]"""
    stiffness: float
    """Of the transmission [N·m/rad]"""
    damping: float
    """Of the transmission [N·m·s/rad]"""
    encoder: Literal["output", "motor"] = "output"
    """The side that is measured"""


@dataclass(frozen=True, slots=True)
class Question:
    """The servo and the loop whose limits are computed."""

    situation: Situation
    """Servo, with bounds where a value is uncertain, and loop; its delay is the whole t_d."""
    delay_parts: DelayParts
    """The parts of the longest t_d, as far as they are known"""
    side: WallSide = "one"
    """``one``: the wall never pulls; ``both``: it also pulls"""
    velocity_samples: int = 1
    load: Load | None = None
    """A load on a transmission; then nothing else may be uncertain, and the servo's inertia and
    friction are those of the motor's side"""

    @property
    def request(self) -> Request:
        """Return the wall to evaluate; its stiffness has no effect on the limits."""
        return Request(0.0, 0.0, "both" if self.side == "both" else "above", self.velocity_samples)

    def plants(self, count: int) -> Plants:
        """Return the least safe corner of the belief, ``count`` times."""
        return Plants.at_corner(self.situation, np.zeros(count))


@dataclass(frozen=True, slots=True)
class Curve:
    """Limits over the virtual damping, at the least safe corner; arrays of one length."""

    virtual_damping: FloatArray
    """[N·m·s/rad]"""
    found: PlantLimits
    passive: FloatArray
    """[N·m/rad]"""
    frequency: FloatArray
    """Frequency of the oscillation at the exact limit [Hz]; 0 where no stiffness is stable"""

    def smallest(self, side: WallSide) -> FloatArray:
        """Return the smallest limit for a wall of that side [N·m/rad], without the passive one."""
        found = replace(self.found, one_sided=None) if side == "both" else self.found
        return found.smallest()


def curve(question: Question, virtual_damping: Sequence[float] | FloatArray) -> Curve:
    """Compute the limits at each virtual damping.

    Args:
        question: The servo and its loop.
        virtual_damping: B, any sign [N·m·s/rad].

    Raises:
        ValueError: A value lies outside its domain; the message names it.
    """
    damping = np.asarray(virtual_damping, dtype=np.float64)
    if question.load is not None:
        return _flexible_curve(question, question.load, damping)
    p = question.plants(damping.size)
    n = question.velocity_samples
    request = question.request
    if not question.situation.belief.is_flexible:  # whose limit differs between the sides
        request = replace(request, side="above")
    found = evaluate_box(request, EVERY_DAMPING, question.situation, p, asked=damping)
    acting = p.gain * damping
    return Curve(
        virtual_damping=damping,
        found=found,
        passive=passive_over_delays(request, question.situation, p, damping),
        frequency=critical_point(p.inertia, p.damping, acting, p.period, p.delay, n).frequency,
    )


def _flexible_curve(question: Question, load: Load, damping: FloatArray) -> Curve:
    """Compute ``curve`` with a load on a transmission; it has no passive limit."""
    p, n = question.plants(damping.size), question.velocity_samples
    acting = p.gain * damping
    chain, _ = two_masses(*_masses(p, load), encoder=load.encoder)
    exact = flexible_boundary(*_masses(p, load), acting, p.period, p.delay, n, encoder=load.encoder)
    one = np.zeros(1, dtype=np.int64)
    period, delay = float(p.period[0]), float(p.delay[0])
    one_sided = one_sided_limits(chain.take(one), period, delay, exact.stiffness, acting, n)
    situation = question.situation
    return Curve(
        virtual_damping=damping,
        found=PlantLimits(
            ceiling=np.full(damping.size, ceiling(question)),
            damping=damping,
            linear=linear_limit(p.damping, acting, p.period, p.delay, n) / p.gain,
            exact=exact.stiffness / p.gain,
            one_sided=one_sided / p.gain,
            quantisation=quantisation_limit(
                question.request, EVERY_DAMPING, situation, damping, p.period
            ),
            passive=None,
        ),
        passive=np.full(damping.size, np.nan),
        frequency=exact.frequency,
    )


def _masses(p: Plants, load: Load) -> tuple[FloatArray, FloatArray, float, float, float]:
    return p.inertia, p.damping, load.inertia, load.stiffness, load.damping


def ceiling(question: Question) -> float:
    """Return the virtual damping above which no stiffness is stable [N·m·s/rad]."""
    p, n, load = question.plants(1), question.velocity_samples, question.load
    if load is None:
        return float(damping_ceiling(question.request, question.situation, p)[0][0])
    top = flexible_ceiling(*_masses(p, load), p.period, p.delay, n, encoder=load.encoder)
    return float((top / p.gain)[0])


def highest(question: Question) -> dict[str, float]:
    """Return the highest stiffness at which any virtual damping makes a two-sided wall stable."""
    p, n, load = question.plants(1), question.velocity_samples, question.load
    if load is None and question.situation.belief.is_flexible:
        return _believed_peak(question)
    if load is None:
        top = peak(p.inertia, p.damping, p.period, p.delay, n)
    else:
        top = _flexible_peak(p, load, n)
    return {
        "stiffness": float((top.stiffness / p.gain)[0]),
        "virtual_damping": float((top.virtual_damping / p.gain)[0]),
        "frequency_hz": float(top.frequency[0]),
    }


def _believed_peak(question: Question) -> dict[str, float]:
    """Return the highest point with a believed load, of a grid of dampings."""
    two_sided = replace(question, side="both")
    found = curve(two_sided, np.linspace(0.0, 1.0, _PEAK_POINTS)[:-1] * ceiling(question))
    stiffness = found.found.exact
    if found.found.flexible is not None:
        stiffness = np.minimum(stiffness, found.found.flexible)
    best = int(np.argmax(stiffness))
    return {
        "stiffness": float(stiffness[best]),
        "virtual_damping": float(found.virtual_damping[best]),
        "frequency_hz": float(found.frequency[best]),
    }


def _flexible_peak(p: Plants, load: Load, n: int) -> CriticalPoint:
    """Return the highest point of a boundary with a load, by an ever finer grid of dampings."""
    low = np.zeros(1)
    high = flexible_ceiling(*_masses(p, load), p.period, p.delay, n, encoder=load.encoder)
    while True:
        damping = np.linspace(low[0], high[0], _PEAK_POINTS)
        found = flexible_boundary(
            *_masses(p, load), damping, p.period, p.delay, n, encoder=load.encoder
        )
        best = int(np.argmax(found.stiffness))
        if high[0] - low[0] <= _PEAK_WIDTH * high[0]:
            one = slice(best, best + 1)
            return CriticalPoint(found.stiffness[one], damping[one], found.frequency[one])
        low, high = damping[max(best - 1, 0), None], damping[min(best + 1, damping.size - 1), None]


def default_dampings(question: Question) -> tuple[float, ...]:
    """Return virtual dampings from zero to 90 % of the ceiling, in two digits [N·m·s/rad]."""
    top = ceiling(question)
    return tuple(float(f"{share * top:.2g}") for share in _DEFAULT_SHARES)
