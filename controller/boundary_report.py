"""The answer of ``haptic-wall boundary``: limits over the virtual damping, and what would help."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from controller.design import (
    ADAPTER,
    FAST_BAUD,
    FINER,
    SHORT_TIMER,
    WIRE,
    Change,
    DelayParts,
    Improvement,
    improvements,
    wire_time,
)
from controller.guard_limits import Found, Plants, evaluate
from controller.guard_types import GuardSettings, Limits, Request, Situation
from controller.theory import critical_point, max_virtual_damping, passive_limit, peak
from controller.theory.checks import FloatArray
from controller.theory.guaranteed import cost_of_each_unknown
from controller.theory.ranges import Member, Ranges

WallSide = Literal["one", "both"]

_EVERY_DAMPING = GuardSettings(mode="off")
"""No damping is cut: what is asked for is evaluated."""
_DEFAULT_SHARES = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9)
_CHANGES: tuple[Change, ...] = (
    "virtual_damping",
    "delay",
    "rate",
    "damping",
    "baud",
    "latency_timer",
    "encoder",
    "two_sided",
    "belief",
)


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
    found = evaluate(request, _EVERY_DAMPING, question.situation, p, asked=damping)
    acting = p.gain * damping
    return Curve(
        virtual_damping=damping,
        found=found,
        passive=passive_limit(p.damping, acting, p.period, p.delay, n) / p.gain,
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


def report(question: Question, virtual_damping: Sequence[float]) -> dict[str, Any]:
    """The whole answer as plain values.

    Args:
        question: The servo and its loop.
        virtual_damping: B of each point, at least one [N·m·s/rad].

    Raises:
        ValueError: Something is outside of its domain; the message names it.
    """
    points = curve(question, virtual_damping)
    answered = design(question, points)
    return {
        "max_virtual_damping": ceiling(question),
        "peak": highest(question),
        "points": [_point(points, i) for i in range(len(virtual_damping))],
        "settings": _settings(question),
        "design": answered,
        "unknown": unknown(question, answered["virtual_damping"]),
    }


def _point(points: Curve, i: int) -> dict[str, float | None]:
    limits = points.found.limits(i)
    return {
        "virtual_damping": float(points.virtual_damping[i]),
        "linear": limits.linear,
        "exact": limits.exact,
        "one_sided": limits.one_sided,
        "passive": float(points.passive[i]),
        "frequency_hz": float(points.frequency[i]),
        "quantisation": limits.quantisation,
    }


def _settings(question: Question) -> dict[str, Any]:
    situation = question.situation
    names = {
        "inertia": situation.belief.inertia,
        "damping": situation.belief.damping,
        "delay": situation.belief.delay,
        "torque_gain": situation.belief.torque_gain,
    }
    return {
        **{name: {"low": each.low, "high": each.high} for name, each in names.items()},
        "period": situation.period,
        "velocity_samples": question.velocity_samples,
    }


def design(question: Question, points: Curve) -> dict[str, Any]:
    """What limits the stiffest wall among the points, and what each improvement would buy.

    Args:
        question: The servo and its loop.
        points: The limits at the virtual dampings that are to choose from.
    """
    best = int(np.argmax(points.smallest(question.side)))
    damping = float(points.virtual_damping[best])
    request = replace(question.request, damping=damping)
    found = points.found.take(np.array([best]))
    if question.side == "both":
        found = replace(found, one_sided=None)
    limits: Limits = found.limits(0)
    binding, stiffness = limits.smallest()
    parts = question.delay_parts
    (better,) = improvements(
        request, _EVERY_DAMPING, question.situation, [parts], found, _CHANGES, thorough=True
    )
    return {
        "side": question.side,
        "virtual_damping": damping,
        "stiffness": stiffness,
        "binding": binding,
        "encoder": question.situation.position_step > 0,
        "delay_parts": [
            {"name": name, "seconds": size, "share": size / parts.total}
            for name, size in parts.sizes().items()
        ],
        "improvements": [
            {
                "change": each.change,
                "description": describe(each, question, damping),
                "stiffness": each.stiffness,
                "factor": each.factor(stiffness),
                "buys": each.buys(stiffness),
                "binding": each.binding,
                "virtual_damping": each.damping,
            }
            for each in better
        ],
    }


def unknown(question: Question, damping: float) -> dict[str, Any] | None:
    """What is guaranteed over all of the ranges, and what each of them costs; two-sided.

    Args:
        question: The servo and its loop.
        damping: Virtual damping [N·m·s/rad].

    Returns:
        None where all is known, or where the servo may have no damping at all: then nothing can
        be guaranteed.
    """
    belief = question.situation.belief
    known = {
        "inertia": belief.inertia,
        "damping": belief.damping,
        "delay": belief.delay,
        "torque_gain": belief.torque_gain,
    }
    open_ = [name for name, each in known.items() if each.low < each.high]
    if not open_ or belief.damping.low == 0:
        return None
    costs = cost_of_each_unknown(
        Ranges(**{name: (each.low, each.high) for name, each in known.items()}),
        Member(**{name: each.value for name, each in known.items()}),
        damping,
        question.situation.period,
        question.velocity_samples,
    )
    return {
        "virtual_damping": damping,
        "guaranteed": costs.limit.stiffness,
        "known": costs.known,
        "lost": costs.lost,
        "costs": [
            {
                "name": each.name,
                "known_at": each.known_at,
                "guaranteed": each.limit.stiffness,
                "lost": each.lost,
            }
            for each in costs.unknowns
            if each.name in open_
        ],
    }


def describe(improvement: Improvement, question: Question, damping: float) -> str:
    """A change in a few words, with its numbers.

    Args:
        improvement: The change.
        question: What it is an improvement of.
        damping: Virtual damping as it is [N·m·s/rad].
    """
    situation, parts = question.situation, question.delay_parts
    period, low = situation.period, situation.belief.damping.low
    match improvement.change:
        case "virtual_damping":
            return f"best virtual damping, {improvement.damping:.3g} instead of {damping:.3g}"
        case "delay":
            return f"half the delay, {_ms(parts.delay / 2)} instead of {_ms(parts.delay)}"
        case "rate":
            return f"twice the rate, {2 / period:.4g} Hz instead of {1 / period:.4g}"
        case "damping":
            return f"twice the viscous damping, {2 * low:.3g} instead of {low:.3g}"
        case "baud":
            fast, now = _ms(wire_time(FAST_BAUD)), _ms(parts.named[WIRE])
            return f"{FAST_BAUD / 1e6:g} Mbit/s, {fast} on the wire instead of {now}"
        case "latency_timer":
            now = _ms(parts.named[ADAPTER])
            return f"an adapter timer of {_ms(SHORT_TIMER)} instead of {now}"
        case "encoder":
            return f"an encoder {FINER} times finer"
        case "two_sided":
            return "a two-sided wall, which also pulls"
        case _:
            return "knowing the servo: the middle of every range"


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms"
