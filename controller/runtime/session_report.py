"""Reports the guard and the oscillation watch at the end of a run, for JSON."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.guard.delay_parts import ms
from haptic_wall.controller.guard.guard import Decision, Situation, decision_report
from haptic_wall.controller.guard.rebound import NOT_ONE_SIDED, rebound
from haptic_wall.controller.guard.schedule import inserted_delay
from haptic_wall.controller.laws.wall import Law
from haptic_wall.controller.runtime.missed import WINDOW_S as MISSED_S
from haptic_wall.controller.runtime.missed import MissedPeriods
from haptic_wall.controller.runtime.overspeed import WINDOW_S
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.runtime.tick import Tick, TickParts
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.servo import BusCounts


def delay_report(config: Config, decision: Decision, age_ns: int) -> dict[str, float]:
    """Return the parts of the delay that the guard used, and their sum [s]."""
    period = config.period_ns * 1e-9
    inserted = inserted_delay(config.delay.steps, period, decision.period)
    return {
        "inserted": inserted,
        "device": config.belief().delay.high,
        "measured": age_ns * 1e-9,
        "total": decision.delay,
    }


def trip_figures(trip: Trip | None, parts: TickParts) -> str:
    """Describe the value that tripped and its limit; empty where the limit is no number."""
    safety, driven, missed = parts.safety.found, parts.motion.driven.found, parts.missed
    match trip:
        case Trip.OVERSPEED if safety:
            return f"{safety[0]:.3g} rad/s between two readings; at most {safety[1]:.3g} is allowed"
        case Trip.OVERSPEED if driven:
            return (
                f"{driven[0]:.3g} rad/s for {WINDOW_S * 1e3:g} ms, driven by the torque; at most"
                f" {driven[1]:.3g} is allowed"
            )
        case Trip.MISSED_PERIODS:
            return (
                f"{missed.worst:.1%} of the periods of {MISSED_S:g} s; at most"
                f" {missed.max_missed:.0%} is allowed"
            )
        case Trip.TRAVEL if safety:
            return f"{safety[0]:.4g} rad; allowed is {safety[1]:.4g} to {safety[2]:.4g}"
        case Trip.LOSSES_IN_ROW if safety:
            return f"{ms(safety[0])} without a reading; at most {ms(safety[1])} is allowed"
        case Trip.LOSS_RATE if safety:
            return f"{safety[0]:.1%} of the readings; at most {safety[1]:.1%} is allowed"
    return ""


def _percent(part: float, whole: float) -> float:
    return 100.0 * part / whole if whole else 100.0


def guard_report(
    config: Config,
    decision: Decision,
    tick: Tick,
    law: Law,
    watch: Watch,
    situation: Situation,
    counts: BusCounts,
) -> dict[str, Any]:
    """Return the guard's decision, the commanded values at the end, and why they differ.

    Args:
        config: The effective configuration.
        decision: The decision at the end.
        tick: The tick, with its commanded values.
        law: The rendered law.
        watch: The oscillation watch, with its derating.
        situation: Servo and loop.
        counts: The bus's.
    """
    report = decision_report(decision)
    if not law.guarded:
        return report | NOT_ONE_SIDED.report()
    stiffness, damping = tick.commanded
    reduced = 1.0 if watch.own is None else watch.own.reduced[0]
    request = decision.request
    limited = replace(
        situation,
        period=decision.period,
        torque_limit=min(situation.torque_limit, law.clip),
    )
    report |= rebound(
        stiffness, damping, request.side, request.velocity_samples, limited, decision.delay
    ).report()
    report["commanded"] = {"stiffness": stiffness, "damping": damping}
    reasons = list(decision.reasons)
    period = config.period_ns * 1e-9
    if decision.period > period:
        reasons.append(_why_slower(decision.period, period, tick.missed, counts))
    if reduced < 1.0 and math.isfinite(watch.first_alarm_s):
        left = _percent(stiffness, decision.stiffness)
        damping_left = _percent(damping, decision.damping)
        reasons.append(
            f"an oscillation of {watch.frequency_hz:.3g} Hz was noticed after "
            f"{watch.first_alarm_s:.3g} s: the stiffness is reduced to {left:.3g} % "
            f"and the damping to {damping_left:.3g} % of what the guard allows, until it is asked "
            "to raise them"
        )
    elif stiffness < decision.stiffness:
        reasons.append(
            f"{decision.stiffness:.4g} N·m/rad are allowed, but K is raised only where that adds "
            "no more than safety.engage_torque, and the shaft has not been there since"
        )
    report["reasons"] = reasons
    return report


def _why_slower(interval: float, period: float, missed: int, counts: BusCounts) -> str:
    """Explain why an interval longer than the grid's counts as the period."""
    start = f"every {ms(interval)} instead of every {ms(period)}, which counts as the period"
    lost = counts.lost + counts.corrupt + counts.refused
    late = "report key timing says what makes ticks late"
    if not lost:
        return f"a tick is executed {start}; {late}"
    replies = f"{lost} of {counts.cycles} replies were lost or broken"
    if not missed:
        return f"a good reading came {start}: {replies}; check cable, power, baud rate and adapter"
    return (
        f"a good reading came {start}: {replies} (check cable, power, baud rate and adapter), and"
        f" {missed} periods were missed ({late})"
    )


def missed_warnings(config: Config, missed: MissedPeriods) -> list[str]:
    """Return a warning where more periods were missed than ``safety.max_missed`` allows."""
    if not missed.exceeded:
        return []
    return [
        f"in the worst half second the loop missed {missed.worst:.0%} of its periods, more than "
        f"safety.max_missed ({config.safety.max_missed:.0%}); stiffness and damping follow the "
        "interval that is really served (guard.interval_s)"
    ]
