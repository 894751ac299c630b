"""Limits of a servo and its loop as functions of the virtual damping (``haptic-wall boundary``)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from haptic_wall.controller.guard.decision_report import finite
from haptic_wall.controller.guard.evaluation import Evaluation
from haptic_wall.controller.guard.limits import BY_NAME, PASSIVE, evaluate, least_of, smallest
from haptic_wall.controller.guard.plants import Plants
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.theory import linear_limit
from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling, chain_peak
from haptic_wall.controller.theory.chain import Chain, one_mass, two_masses
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.one_sided import one_sided_with_load
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
    work: Work = field(default_factory=Work, compare=False, repr=False)
    """Results of earlier evaluations"""

    @property
    def request(self) -> Request:
        """Return the wall to evaluate; its stiffness has no effect on the limits."""
        side: Side = "both" if self.side == "both" else "above"
        return Request(0.0, 0.0, side, self.velocity_samples, velocity_filter=self.velocity_filter)

    def plants(self, count: int) -> Plants:
        """Return the least safe corner of the belief, ``count`` times."""
        return Plants.at_corner(self.situation, np.zeros(count))

    def chain(self) -> tuple[Chain, tuple[int, ...]]:
        """Return that corner's servo, with its load."""
        p, load = self.plants(1), self.load
        if load is None:
            return one_mass(p.inertia, p.damping)
        rest = (load.inertia, load.stiffness, load.damping)
        return two_masses(p.inertia, p.damping, *rest, encoder=load.encoder)

    @property
    def loop(self) -> tuple[float, float, int]:
        """Return period [s], delay [s] and velocity samples."""
        return self.situation.period, self.situation.belief.delay.high, self.velocity_samples


@dataclass(frozen=True, slots=True)
class Curve:
    """Limits over the virtual damping, at the least safe corner; arrays of one length."""

    virtual_damping: FloatArray
    """[N·m·s/rad]"""
    limits: dict[str, FloatArray]
    """By name, of those that apply [N·m/rad]"""
    passive: FloatArray
    """[N·m/rad]"""
    frequency: FloatArray
    """Frequency of the oscillation at the exact limit [Hz]; 0 where no stiffness is stable"""

    def smallest(self, side: WallSide) -> FloatArray:
        """Return the smallest limit for a wall of that side [N·m/rad], without the passive one."""
        omitted = "one_sided" if side == "both" else ""
        return least_of({name: each for name, each in self.limits.items() if name != omitted})


def curve(question: Question, virtual_damping: Sequence[float] | FloatArray) -> Curve:
    """Compute the limits at each virtual damping.

    Args:
        question: The servo and its loop.
        virtual_damping: B, any sign [N·m·s/rad].

    Raises:
        ValueError: A value lies outside its domain; the message names it.
    """
    damping = np.asarray(virtual_damping, dtype=np.float64)
    p, filtered = question.plants(damping.size), question.velocity_filter
    acting, unknown = p.gain * damping, np.full(damping.size, np.nan)
    exact = chain_boundary(*question.chain(), acting, *question.loop, filtered)
    if question.load is not None:
        servo = (question.chain()[0], exact.stiffness)
        limits = {
            "linear": linear_limit(p.damping, acting, p.period, p.delay) / p.gain,
            "exact": exact.stiffness / p.gain,
            "one_sided": one_sided_with_load(*servo, acting, *question.loop) / p.gain,
        }
        return Curve(damping, limits, unknown, exact.frequency)
    request = question.request
    if not question.situation.belief.is_flexible and filtered is None:
        request = replace(request, side="above")  # with a load the limit differs between the sides
    situation, known = question.situation, question.work
    wall = Evaluation(request, EVERY_DAMPING, situation, p, exact=True, asked=damping, work=known)
    passive = unknown if filtered else PASSIVE.stiffness(wall)
    return Curve(damping, evaluate(wall), passive, exact.frequency)


def ceiling(question: Question) -> float:
    """Return the virtual damping above which no stiffness is stable [N·m·s/rad]."""
    if question.load is None:
        return float(_evaluation(question).ceiling[0])
    top = chain_ceiling(*question.chain(), *question.loop, question.velocity_filter)
    return float((top / question.plants(1).gain)[0])


def _evaluation(question: Question) -> Evaluation:
    asked = (question.request, EVERY_DAMPING, question.situation, question.plants(1))
    return Evaluation(*asked, work=question.work)


def highest(question: Question) -> dict[str, float]:
    """Return the highest stiffness at which any virtual damping makes a two-sided wall stable."""
    belief, gain = question.situation.belief, question.plants(1).gain
    filtered = question.velocity_filter is not None and not belief.is_known
    if question.load is None and (belief.is_flexible or filtered):
        return _believed_peak(question)
    top = chain_peak(question.chain()[0], *question.loop, question.velocity_filter)
    return {
        "stiffness": float((top.stiffness / gain)[0]),
        "virtual_damping": float((top.virtual_damping / gain)[0]),
        "frequency_hz": float(top.frequency[0]),
    }


def _believed_peak(question: Question) -> dict[str, float]:
    """Return the highest point of a belief with a load or a filter, of a grid of dampings."""
    two_sided = replace(question, side="both")
    found = curve(two_sided, np.linspace(0.0, 1.0, _PEAK_POINTS)[:-1] * ceiling(question))
    stiffness = np.minimum(found.limits["exact"], found.limits.get("flexible", np.inf))
    best = int(np.argmax(stiffness))
    return {
        "stiffness": float(stiffness[best]),
        "virtual_damping": float(found.virtual_damping[best]),
        "frequency_hz": float(found.frequency[best]),
    }


def encoder_ceiling(question: Question) -> float:
    """Return the virtual damping at which one encoder count commands the most that it may.

    Returns:
        [N·m·s/rad]; infinite: position or torque limit is not known.
    """
    return float(_evaluation(question).encoder_damping[0])


def default_dampings(question: Question) -> tuple[float, ...]:
    """Return virtual dampings from zero to 90 % of the lower ceiling, in two digits [N·m·s/rad]."""
    top = min(ceiling(question), encoder_ceiling(question))
    return tuple(float(f"{share * top:.2g}") for share in _DEFAULT_SHARES)


def report(question: Question, virtual_damping: Sequence[float]) -> dict[str, Any]:
    """Return the whole answer of ``haptic-wall boundary`` as plain values.

    Args:
        question: The servo and its loop.
        virtual_damping: B of each point, at least one [N·m·s/rad].

    Raises:
        ValueError: A value lies outside its domain; the message names it.
    """
    found = curve(question, virtual_damping)
    points = [_point(found, i) for i in range(len(virtual_damping))]
    best = int(np.argmax(found.smallest(question.side)))
    limits = {name: points[best][name] for name in BY_NAME if name in found.limits}
    if question.side == "both":
        limits.pop("one_sided", None)
    binding, stiffness = smallest(limits)
    return {
        "max_virtual_damping": ceiling(question),
        "encoder_damping": finite(encoder_ceiling(question)),
        "peak": highest(question),
        "points": points,
        "design": {
            "side": question.side,
            "virtual_damping": points[best]["virtual_damping"],
            "stiffness": stiffness,
            "binding": binding,
        },
    }


def _point(found: Curve, i: int) -> dict[str, float | None]:
    limits = {name: float(each[i]) for name, each in found.limits.items()}
    return {
        "virtual_damping": float(found.virtual_damping[i]),
        **dict.fromkeys(BY_NAME),
        **limits,
        "passive": None if np.isnan(found.passive[i]) else float(found.passive[i]),
        "frequency_hz": float(found.frequency[i]),
    }
