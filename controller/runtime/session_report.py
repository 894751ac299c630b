"""Reports the guard and the oscillation watch at the end of a run, for JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from haptic_wall.controller.detector.state import State
from haptic_wall.controller.guard.decision_report import assumed, decision_report
from haptic_wall.controller.guard.types import Decision, Situation
from haptic_wall.controller.milliseconds import ms
from haptic_wall.controller.runtime.axis import Axis
from haptic_wall.controller.settings.config import Config

NOTED_S = 0.005
"""Sum of the stalls from which they are noted [s]"""


def delay_report(situation: Situation, decision: Decision) -> dict[str, float]:
    """Return the parts of the delay that the guard used, and their sum [s]."""
    inserted, device, total = decision.inserted, situation.belief.delay.high, decision.delay
    # Several bins may share a decision, whose age is that of the oldest; ages are whole ns.
    measured = max(0.0, round(total - inserted - device, 9))
    return {"inserted": inserted, "device": device, "measured": measured, "total": total}


def guard_report(
    config: Config,
    decision: Decision,
    axis: Axis,
    missed: int,
    situation: Situation,
    bus: Mapping[str, Any] | None,
) -> dict[str, Any]:
    """Return the guard's decision, the commanded values at the end, and why they differ.

    Args:
        config: The effective configuration.
        decision: The decision at the end.
        axis: The axis.
        missed: Whole periods skipped.
        situation: Servo and loop.
        bus: Counts of the servo's replies; None: none travels.
    """
    if not axis.law.guarded:
        return decision_report(decision) | {"assumed": None}
    model, belief = config.model, situation.belief
    unknown = model.flexible_hz is None and (
        config.servo.kind == "hardware" or belief.transmission_stiffness.high > 0.0
    )
    reasons = list(_reasons(config, decision, axis, missed, bus))
    return {
        **decision_report(decision, reasons, now=axis.commanded),
        "assumed": assumed(belief, decision) if unknown else None,
    }


def _reasons(
    config: Config, decision: Decision, axis: Axis, missed: int, bus: Mapping[str, Any] | None
) -> Iterator[str]:
    """Say why less is commanded than requested: an oscillation first, then the guard's reasons."""
    watch, (stiffness, damping) = axis.watch, axis.commanded
    reduced = watch.backstop.wall.reduced[0] < 1.0 and math.isfinite(watch.first_alarm_s)
    if reduced:
        yield (
            f"an oscillation of {watch.frequency_hz:.3g} Hz was found after "
            f"{watch.first_alarm_s:.3g} s: the stiffness is reduced to "
            f"{100 * _share(stiffness, decision.stiffness):.3g} % and the damping to "
            f"{100 * _share(damping, decision.damping):.3g} % of what the guard allows, until "
            "`kill -USR1` requests the full wall; model.delay or another value of model.* may be "
            "wrong"
        )
    yield from decision.reasons
    if decision.period > config.period_ns * 1e-9:
        yield _slower(config, decision, missed, bus)
    if stiffness < decision.stiffness and not reduced:
        yield (
            f"{decision.stiffness:.4g} N·m/rad are allowed, but K rises only at positions where "
            "this adds at most safety.engage_torque, and the shaft has not been there since"
        )


def _slower(config: Config, decision: Decision, missed: int, bus: Mapping[str, Any] | None) -> str:
    """Say that the guard counts a longer period than the grid's, and why."""
    failed, causes = bus["lost"] + bus["corrupt"] + bus["refused"] if bus else 0, []
    if bus and failed:
        causes.append(f"{failed} of {bus['cycles']} replies were lost or broken")
    if missed or not failed:
        causes.append("ticks were late")
    return (
        f"the guard counts a period of {ms(decision.period)} instead of "
        f"{ms(config.period_ns * 1e-9)}, because {' and '.join(causes)}"
    )


def _share(part: float, whole: float) -> float:
    return part / whole if whole else 1.0


def all_axes(parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return what the parts of a report on each axis say together; of one they are its own."""
    if len(parts) == 1:
        return dict(parts[0])
    watched = [part["oscillation"] for part in parts if "oscillation" in part]
    delays = [part["delay_s"] for part in parts if "delay_s" in part]
    counts = [part["bus"] for part in parts if part["bus"] is not None]
    return {
        "oscillation": max(watched, key=_severity, default=None),
        "delay_s": max(delays, key=lambda delay: delay["total"], default=None),
        "wall_came_on": all(part["wall_came_on"] for part in parts),
        "bus": {key: sum(each[key] for each in counts) for key in counts[0]} if counts else None,
    }


def _severity(seen: Mapping[str, Any]) -> tuple[int, float, int]:
    """Return the rank of what a watch has seen."""
    return State[seen["state"].upper()], seen["amplitude_rad"] or 0.0, seen["probes"]


def missed_warnings(config: Config, worst: float) -> list[str]:
    """Return a warning where more periods were missed than ``safety.max_missed`` allows.

    Args:
        config: The effective configuration.
        worst: Largest fraction of missed periods [1].
    """
    if worst <= config.safety.max_missed:
        return []
    return [
        f"in the worst half second the loop missed {worst:.0%} of its periods, more than "
        f"safety.max_missed ({config.safety.max_missed:.0%}); stiffness and damping follow the "
        "served interval (guard.interval_s)"
    ]


def stall_warnings(stalled_s: float | None) -> list[str]:
    """Return a warning where loop and emulated bus waited for this computer."""
    if not stalled_s or stalled_s < NOTED_S:
        return []
    return [
        f"the loop and its emulated bus waited {1e3 * stalled_s:.0f} ms for this computer; a real"
        " servo does not wait: its torque would have been late, or a trip had ended the run"
    ]
