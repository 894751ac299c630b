"""The limits of a servo in its loop over the virtual damping, for ``haptic-wall boundary``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from haptic_wall.controller.guard.delay_parts import DelayParts
from haptic_wall.controller.guard.limits import Found, evaluate_box, passive_over_delays
from haptic_wall.controller.guard.plants import Plants
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from haptic_wall.controller.theory import critical_point, max_virtual_damping, peak
from haptic_wall.controller.theory.checks import FloatArray

WallSide = Literal["one", "both"]

EVERY_DAMPING = GuardSettings(mode="off")
"""No damping is cut: what is asked for is evaluated."""
_DEFAULT_SHARES = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9)


@dataclass(frozen=True, slots=True)
class Question:
    """A servo in a loop, whose limits are asked for."""

    situation: Situation
    """With ranges where something is not known exactly. The delay is all of t_d."""
    delay_parts: DelayParts
    """What t_d at its longest is made of, as far as it is known"""
    side: WallSide = "one"
    """``one``: the wall never pulls; ``both``: it also pulls"""
    velocity_samples: int = 1

    @property
    def request(self) -> Request:
        """The wall as the guard is asked for it; its stiffness plays no part."""
        return Request(0.0, 0.0, "both" if self.side == "both" else "above", self.velocity_samples)

    def plants(self, count: int) -> Plants:
        """The least safe corner of what is believed, ``count`` times."""
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
    """Of the oscillation at the exact limit [Hz]; 0 where no stiffness is stable"""

    def smallest(self, side: WallSide) -> FloatArray:
        """The smallest limit of a wall of that side [N·m/rad]; passivity is not counted."""
        found = replace(self.found, one_sided=None) if side == "both" else self.found
        return found.smallest()


def curve(question: Question, virtual_damping: Sequence[float] | FloatArray) -> Curve:
    """The limits at each virtual damping.

    Args:
        question: The servo and its loop.
        virtual_damping: B, any sign [N·m·s/rad].

    Raises:
        ValueError: Something is outside of its domain; the message names it.
    """
    damping = np.asarray(virtual_damping, dtype=np.float64)
    p = question.plants(damping.size)
    n = question.velocity_samples
    request = replace(question.request, side="above")
    found = evaluate_box(request, EVERY_DAMPING, question.situation, p, asked=damping)
    acting = p.gain * damping
    return Curve(
        virtual_damping=damping,
        found=found,
        passive=passive_over_delays(request, question.situation, p, damping),
        frequency=critical_point(p.inertia, p.damping, acting, p.period, p.delay, n).frequency,
    )


def ceiling(question: Question) -> float:
    """Virtual damping above which no stiffness is stable [N·m·s/rad]."""
    p, n = question.plants(1), question.velocity_samples
    return float((max_virtual_damping(p.inertia, p.damping, p.period, p.delay, n) / p.gain)[0])


def highest(question: Question) -> dict[str, float]:
    """The greatest stiffness that any virtual damping makes stable, two-sided."""
    p, n = question.plants(1), question.velocity_samples
    top = peak(p.inertia, p.damping, p.period, p.delay, n)
    return {
        "stiffness": float((top.stiffness / p.gain)[0]),
        "virtual_damping": float((top.virtual_damping / p.gain)[0]),
        "frequency_hz": float(top.frequency[0]),
    }


def default_dampings(question: Question) -> tuple[float, ...]:
    """No virtual damping, and shares of the ceiling to 90 %, in two digits [N·m·s/rad]."""
    top = ceiling(question)
    return tuple(float(f"{share * top:.2g}") for share in _DEFAULT_SHARES)
