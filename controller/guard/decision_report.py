"""Converts the guard's decision to plain data for a report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from haptic_wall.controller.guard.reasons import sentences
from haptic_wall.controller.guard.types import Decision
from haptic_wall.controller.theory.velocity_filter import VelocityFilter


def decision_report(
    decision: Decision,
    further: Sequence[str] = (),
    now: tuple[float, float] | None = None,
) -> dict[str, object]:
    """Return the decision for a JSON report: no NaN, no infinity, None for what does not apply.

    Args:
        decision: Decision of the guard.
        further: Reasons besides the guard's, placed after them.
        now: Stiffness and damping that are really commanded; None: those of the decision.
    """
    stiffness, damping = now or (decision.stiffness, decision.damping)
    return {
        "requested": {
            "stiffness": decision.request.stiffness,
            "damping": decision.request.damping,
        },
        "commanded": {"stiffness": stiffness, "damping": damping},
        "limit": dict(decision.limits),
        "damping_ceiling": decision.damping_ceiling,
        "encoder_damping": finite(decision.encoder_damping),
        "margin": decision.margin,
        "binding": decision.binding,
        "reasons": [*sentences(decision.reasons, now), *further],
        "only_friction": decision.only_friction,
        "interval_s": decision.period,
        "velocity_filter": filter_report(decision.request.velocity_filter, decision.period),
    }


def finite(value: float) -> float | None:
    """Return a value for a report: None for infinity."""
    return value if math.isfinite(value) else None


def filter_report(velocity_filter: VelocityFilter | None, period: float) -> dict[str, Any] | None:
    """Return a filter of the velocity for a report; None: there is none.

    Args:
        velocity_filter: The filter.
        period: Period that is counted: a longer one makes the filter slower [s].
    """
    if velocity_filter is None:
        return None
    hertz = velocity_filter.w0 / (math.tau * period)
    return {"kind": velocity_filter.kind, "frequency_hz": hertz, "q": velocity_filter.q}
