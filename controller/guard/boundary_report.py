"""Assembles the answer of ``haptic-wall boundary``: limits, and the effect of improvements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any, get_args

import numpy as np

from haptic_wall.controller.guard.boundary_curve import (
    EVERY_DAMPING,
    Curve,
    Question,
    ceiling,
    curve,
    highest,
)
from haptic_wall.controller.guard.decision_report import filter_report, finite
from haptic_wall.controller.guard.design import Change, Improvement, Wall, improvements
from haptic_wall.controller.guard.limits import smallest

_CHANGES: tuple[str, ...] = tuple(c for c in get_args(Change) if c != "largest_part")
_BELIEVED = ("inertia", "damping", "delay", "torque_gain")


def report(question: Question, virtual_damping: Sequence[float]) -> dict[str, Any]:
    """Return the whole answer as plain values.

    Args:
        question: The servo and its loop.
        virtual_damping: B of each point, at least one [N·m·s/rad].

    Raises:
        ValueError: A value lies outside its domain; the message names it.
    """
    points = curve(question, virtual_damping)
    return {
        "max_virtual_damping": ceiling(question),
        "encoder_damping": finite(float(points.found.encoder_damping[0])),
        "peak": highest(question),
        "points": [_point(points, i) for i in range(len(virtual_damping))],
        "settings": _settings(question),
        "design": design(question, points),
    }


def _point(points: Curve, i: int) -> dict[str, float | None]:
    return {
        "virtual_damping": float(points.virtual_damping[i]),
        **points.found.at(i),
        "passive": None if np.isnan(points.passive[i]) else float(points.passive[i]),
        "frequency_hz": float(points.frequency[i]),
    }


def _settings(question: Question) -> dict[str, Any]:
    situation = question.situation
    names = {name: getattr(situation.belief, name) for name in _BELIEVED}
    load = question.load
    flexible: dict[str, Any] = {} if load is None else {"load": asdict(load)}
    belief = situation.belief
    if belief.is_flexible:
        flexible["believed_load"] = {
            name: {"low": each.low, "high": each.high}
            for name, each in (
                ("inertia", belief.load_inertia),
                ("frequency_hz", belief.flexible_hz),
                ("damping_ratio", belief.flexible_damping_ratio),
            )
        } | {"encoder": belief.encoder}
    return {
        **{name: {"low": each.low, "high": each.high} for name, each in names.items()},
        "period": situation.period,
        "velocity_samples": question.velocity_samples,
        "velocity_filter": filter_report(question.velocity_filter, situation.period),
        **flexible,
    }


def design(question: Question, points: Curve) -> dict[str, Any]:
    """Return the limit of the stiffest wall among the points, and the effect of each improvement.

    Args:
        question: The servo and its loop.
        points: The limits at the candidate virtual dampings.
    """
    best = int(np.argmax(points.smallest(question.side)))
    damping = float(points.virtual_damping[best])
    request = replace(question.request, damping=damping)
    limits = points.found.at(best)
    if question.side == "both":
        limits["one_sided"] = None
    binding, stiffness = smallest(limits)
    parts = question.delay_parts
    better: Sequence[Improvement] = ()
    if not question.is_exact:  # what a change would buy is known of a rigid servo
        wall = Wall(request, EVERY_DAMPING, question.situation, parts)
        better = improvements(wall, _CHANGES, exact=True)
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
                "description": each.text,
                "stiffness": each.stiffness,
                "factor": each.factor(stiffness),
                "buys": each.buys(stiffness),
                "binding": each.binding,
                "virtual_damping": each.damping,
            }
            for each in better
        ],
    }
