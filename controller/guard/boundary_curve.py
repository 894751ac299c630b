"""Limits of a servo and its loop as functions of the virtual damping (``haptic-wall boundary``)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from haptic_wall.controller.guard.delay_parts import DelayParts
from haptic_wall.controller.guard.evaluation import (
    Evaluation,
    encoder_damping,
    quantisation_limit,
)
from haptic_wall.controller.guard.limits import PASSIVE, Found, evaluate
from haptic_wall.controller.guard.plants import Plants
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.theory import linear_limit
from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling, chain_peak
from haptic_wall.controller.theory.chain import Chain, one_mass, two_masses
from haptic_wall.controller.theory.chain_contact import one_sided_limits
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.velocity_filter import VelocityFilter

WallSide = Literal["one", "both"]

EVERY_DAMPING = GuardSettings(mode="off")
"""Guard settings that evaluate the limits at any damping, without clamping it."""
_PEAK_POINTS = 33
_DEFAULT_SHARES = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9)


@dataclass(frozen=True, slots=True)
class Load:
    """The load that the motor side turns through a flexible transmission."""

    inertia: float
    """[kg·m²]"""
    stiffness: float
    """Stiffness of the transmission [N·m/rad]"""
    damping: float
    """Damping of the transmission [N·m·s/rad]"""
    encoder: Literal["output", "motor"] = "output"
    """The side that is measured"""


@dataclass(frozen=True, slots=True)
class Question:
    """The servo and the loop whose limits are computed."""

    situation: Situation
    """Servo, with bounds where a value is uncertain, and loop; its delay is the whole t_d."""
    side: WallSide = "one"
    """``one``: the wall never pulls; ``both``: it also pulls"""
    velocity_samples: int = 1
    load: Load | None = None
    """A load on a transmission; then nothing else may be uncertain, and the servo's inertia and
    friction are those of the motor's side"""
    velocity_filter: VelocityFilter | None = None
    """Of the velocity that damps; only for two-sided walls"""

    @property
    def request(self) -> Request:
        """Return the wall to evaluate; its stiffness has no effect on the limits."""
        side: Side = "both" if self.side == "both" else "above"
        return Request(0.0, 0.0, side, self.velocity_samples, velocity_filter=self.velocity_filter)

    @property
    def delay_parts(self) -> DelayParts:
        """Return the longest t_d, and half the period."""
        return DelayParts(self.situation.period, {"delay": self.situation.belief.delay.high})

    @property
    def is_exact(self) -> bool:
        """Whether everything is known of a servo with a load or a filter: no margin is needed."""
        filtered = self.velocity_filter is not None
        belief = self.situation.belief
        return self.load is not None or (filtered and belief.is_known and not belief.is_flexible)

    def plants(self, count: int) -> Plants:
        """Return the least safe corner of the belief, ``count`` times."""
        return Plants.at_corner(self.situation, np.zeros(count))


@dataclass(frozen=True, slots=True)
class Curve:
    """Limits over the virtual damping, at the least safe corner; arrays of one length."""

    virtual_damping: FloatArray
    """[N·m·s/rad]"""
    found: Found
    passive: FloatArray
    """[N·m/rad]"""
    frequency: FloatArray
    """Frequency of the oscillation at the exact limit [Hz]; 0 where no stiffness is stable"""

    def smallest(self, side: WallSide) -> FloatArray:
        """Return the smallest limit for a wall of that side [N·m/rad], without the passive one."""
        limits = dict(self.found.limits)
        if side == "both":
            limits.pop("one_sided", None)
        least: FloatArray = np.min([*limits.values()], axis=0)
        return least


def curve(question: Question, virtual_damping: Sequence[float] | FloatArray) -> Curve:
    """Compute the limits at each virtual damping.

    Args:
        question: The servo and its loop.
        virtual_damping: B, any sign [N·m·s/rad].

    Raises:
        ValueError: A value lies outside its domain; the message names it.
    """
    damping = np.asarray(virtual_damping, dtype=np.float64)
    if question.is_exact:
        return _exact_curve(question, damping)
    p = question.plants(damping.size)
    n = question.velocity_samples
    request = question.request
    filtered = question.velocity_filter
    if not question.situation.belief.is_flexible and filtered is None:
        request = replace(request, side="above")  # with a load the limit differs between the sides
    wall = Evaluation(request, EVERY_DAMPING, question.situation, p, exact=True, asked=damping)
    found = evaluate(wall)
    passive = np.full(damping.size, np.nan) if filtered else PASSIVE.stiffness(wall)
    chain, shape = one_mass(p.inertia, p.damping)
    at = chain_boundary(chain, shape, p.gain * damping, p.period, p.delay, n, filtered)
    return Curve(damping, found, passive, at.frequency)


def _exact_curve(question: Question, damping: FloatArray) -> Curve:
    """Compute ``curve`` with a load on a transmission or a filter; it has no passive limit."""
    p, n = question.plants(damping.size), question.velocity_samples
    acting = p.gain * damping
    top = np.full(damping.size, ceiling(question))
    rigid = top if question.load is None else np.full_like(top, np.inf)
    chain, shape = _chain(question, p)
    loop = (acting, p.period, p.delay, n, question.velocity_filter)
    exact = chain_boundary(chain, shape, *loop)
    limits = {
        "linear": linear_limit(p.damping, acting, p.period, p.delay, n) / p.gain,
        "exact": exact.stiffness / p.gain,
    }
    if question.velocity_filter is None:
        one = np.zeros(1, dtype=np.int64)
        period, delay = float(p.period[0]), float(p.delay[0])
        one_sided = one_sided_limits(chain.take(one), period, delay, exact.stiffness, acting, n)
        limits["one_sided"] = one_sided / p.gain
    asked = (question.request, EVERY_DAMPING, question.situation)
    if question.situation.position_step > 0:
        limits["quantisation"] = quantisation_limit(*asked, damping, p.period, rigid)
    found = Found(
        limits, top, damping, encoder_damping(*asked, p.period, rigid), np.zeros(top.size, np.bool_)
    )
    return Curve(damping, found, np.full(damping.size, np.nan), exact.frequency)


def _chain(question: Question, p: Plants) -> tuple[Chain, tuple[int, ...]]:
    """Return the servo without a transmission or with one, as chains."""
    load = question.load
    if load is None:
        return one_mass(p.inertia, p.damping)
    rest = (load.inertia, load.stiffness, load.damping)
    return two_masses(p.inertia, p.damping, *rest, encoder=load.encoder)


def ceiling(question: Question) -> float:
    """Return the virtual damping above which no stiffness is stable [N·m·s/rad]."""
    p, n = question.plants(1), question.velocity_samples
    if not question.is_exact:
        at = Evaluation(question.request, EVERY_DAMPING, question.situation, p)
        return float(at.ceiling[0])
    top = chain_ceiling(*_chain(question, p), p.period, p.delay, n, question.velocity_filter)
    return float((top / p.gain)[0])


def highest(question: Question) -> dict[str, float]:
    """Return the highest stiffness at which any virtual damping makes a two-sided wall stable."""
    p, n = question.plants(1), question.velocity_samples
    believed = question.situation.belief.is_flexible or question.velocity_filter is not None
    if believed and not question.is_exact:
        return _believed_peak(question)
    top = chain_peak(_chain(question, p)[0], p.period, p.delay, n, question.velocity_filter)
    return {
        "stiffness": float((top.stiffness / p.gain)[0]),
        "virtual_damping": float((top.virtual_damping / p.gain)[0]),
        "frequency_hz": float(top.frequency[0]),
    }


def _believed_peak(question: Question) -> dict[str, float]:
    """Return the highest point of a belief with a load or a filter, of a grid of dampings."""
    two_sided = replace(question, side="both")
    found = curve(two_sided, np.linspace(0.0, 1.0, _PEAK_POINTS)[:-1] * ceiling(question))
    limits = found.found.limits
    stiffness = np.minimum(limits["exact"], limits.get("flexible", np.inf))
    best = int(np.argmax(stiffness))
    return {
        "stiffness": float(stiffness[best]),
        "virtual_damping": float(found.virtual_damping[best]),
        "frequency_hz": float(found.frequency[best]),
    }


def default_dampings(question: Question) -> tuple[float, ...]:
    """Return virtual dampings from zero to 90 % of the ceiling, in two digits [N·m·s/rad]."""
    top = ceiling(question)
    return tuple(float(f"{share * top:.2g}") for share in _DEFAULT_SHARES)
