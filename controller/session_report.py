"""What the guard and the watch have to say at the end of a run, as JSON can hold it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from controller.detector.watch import Watch
from controller.guard.delay_parts import ms
from controller.guard.guard import Decision, Situation, decision_report
from controller.guard.rebound import NOT_ONE_SIDED, rebound
from controller.guard.schedule import inserted_delay
from controller.missed import MissedPeriods
from controller.settings.config import Config
from controller.tick import Tick
from controller.wall import Law


def delay_report(config: Config, decision: Decision, age_ns: int) -> dict[str, float]:
    """The parts of the delay that the guard counted with, and their sum [s]."""
    period = config.period_ns * 1e-9
    inserted = inserted_delay(config.delay.steps, period, decision.period)
    return {
        "inserted": inserted,
        "device": config.belief().delay.high,
        "measured": age_ns * 1e-9,
        "total": decision.delay,
    }


def _percent(part: float, whole: float) -> float:
    return 100.0 * part / whole if whole else 100.0


def guard_report(
    config: Config,
    decision: Decision,
    tick: Tick,
    law: Law,
    watch: Watch,
    situation: Situation,
) -> dict[str, Any]:
    """The guard's decision, with what is really commanded at the end, and why that differs.

    Args:
        config: The effective configuration.
        decision: The decision that holds at the end.
        tick: What was commanded.
        law: What is rendered.
        watch: What it had to reduce.
        situation: What the wall was rendered on.
    """
    report = decision_report(decision)
    if not law.guarded:
        return report | NOT_ONE_SIDED.report()
    stiffness, damping = tick.commanded
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
        reasons.append(
            f"a tick is executed every {ms(decision.period)} instead of every {ms(period)}, which "
            "counts as the period; report key timing says what makes ticks late"
        )
    if watch.share * watch.scale < 1.0:
        left = _percent(stiffness, decision.stiffness)
        damping_left = _percent(damping, decision.damping)
        reasons.append(
            f"an oscillation of {watch.frequency_hz:.3g} Hz was noticed after "
            f"{watch.first_alarm_s:.3g} s: the stiffness is reduced to {left:.3g} % "
            f"and the damping to {damping_left:.3g} % of what the guard allows, "
            f"{law.injected:.3g} N·m·s/rad are put in, until it is asked to raise them"
        )
    elif stiffness < decision.stiffness:
        reasons.append(
            f"{decision.stiffness:.4g} N·m/rad are allowed, but K is raised only where that adds "
            "no more than safety.engage_torque, and the shaft has not been there since"
        )
    report["reasons"] = reasons
    return report


def missed_warnings(config: Config, missed: MissedPeriods) -> list[str]:
    """One warning where more periods were missed than ``safety.max_missed`` allows."""
    if not missed.exceeded:
        return []
    return [
        f"in the worst half second the loop missed {missed.worst:.0%} of its periods, more than "
        f"safety.max_missed ({config.safety.max_missed:.0%}); stiffness and damping follow the "
        "interval that is really served (guard.interval_s)"
    ]
