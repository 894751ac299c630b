"""The guard's decision as a report holds it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

from haptic_wall.controller.guard.reasons import Reason
from haptic_wall.controller.guard.sentences import sentences
from haptic_wall.controller.guard.types import Decision, Limits


def decision_report(
    decision: Decision, further: Sequence[Reason] = (), asked: bool = True
) -> dict[str, object]:
    """Return the decision for a JSON report: no NaN, no infinity, None for what does not apply.

    Args:
        decision: Of the guard.
        further: Reasons besides the guard's, placed after them.
        asked: As for ``sentences``.
    """
    return {
        "requested": {
            "stiffness": decision.request.stiffness,
            "damping": decision.request.damping,
        },
        "commanded": {"stiffness": decision.stiffness, "damping": decision.damping},
        "limit": {f.name: getattr(decision.limits, f.name) for f in fields(Limits)},
        "damping_ceiling": decision.damping_ceiling,
        "margin": decision.margin,
        "binding": None if decision.binding is None else decision.binding.value,
        "reasons": sentences([*decision.reasons, *further], asked),
        "only_friction": decision.only_friction,
        "interval_s": decision.period,
    }
