"""Converts the guard's decision to plain data for a report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from haptic_wall.controller.guard.belief import Belief
from haptic_wall.controller.guard.types import Decision
from haptic_wall.controller.theory.velocity_filter import VelocityFilter

_MEASURE = (
    "identify the servo with its link on, and set model.inertia, model.load_inertia and"
    " model.flexible_hz"
)


def decision_report(
    decision: Decision,
    reasons: Sequence[str] | None = None,
    now: tuple[float, float] | None = None,
) -> dict[str, object]:
    """Return the decision for a JSON report: no NaN, no infinity, None for what does not apply.

    Args:
        decision: Decision of the guard.
        reasons: Why less is commanded than requested; None: the guard's reasons alone.
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
        "reasons": list(decision.reasons if reasons is None else reasons),
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


def assumed(belief: Belief, decision: Decision) -> str:
    """Return in words which gear train and horn are assumed, and what a link would change.

    Args:
        belief: One without a measured vibration.
        decision: Decision in force.
    """
    train = belief.transmission_stiffness
    servo = "a rigid servo without a link"
    if train.high > 0.0:
        servo = f"a gear train of {train.low:g} to {train.high:g} N·m/rad"
    if belief.is_flexible:
        servo += f" with a load of at most {belief.load_inertia.high:.2g} kg·m²"
    return (
        f"no vibration is known (model.flexible_hz is not set): {servo} is assumed. A link on the"
        " horn may vibrate at a virtual damping far below the ceiling of"
        f" {decision.damping_ceiling:.3g} N·m·s/rad: {_MEASURE}"
    )
