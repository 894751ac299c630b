"""Builds what a tick works with from a configuration: wall, guard, safety, watch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from controller.delay import DelayRing
from controller.detector.oscillation import DetectorSettings
from controller.detector.watch import Answer, Watch, WatchSettings
from controller.guard.guard import Decision, GuardSettings, Situation, decide
from controller.guard.limits import Plants
from controller.guard.schedule import (
    IRREGULAR_CAP,
    RUN,
    RUN_S,
    GainSchedule,
    age_bins_ns,
    inserted_delay,
    interval_bins_ns,
)
from controller.missed import MissedPeriods
from controller.passivity_control import PassivityControl
from controller.program import Phase, Program
from controller.rehearsal import Rehearsal, StandInClock
from controller.safety import Safety, SafetyLimits
from controller.settings.config import Config
from controller.telemetry import Telemetry
from controller.theory import peak
from controller.tick import Tick, TickParts
from controller.velocity import velocity_estimator
from controller.wall import SIGNS, Law, Wall
from hw.clock import Clock
from hw.servo import Servo

RAMP_S = 0.05
"""How long a lower stiffness takes to be reached [s]; a jump would be felt as a knock."""
SLOWEST = 0.05
"""Speed below which passivity control takes energy back no faster [rad/s]"""


def guard_schedule(config: Config, servo: Servo, simulated: bool) -> GainSchedule:
    """The guard's decisions for every sample age and every served interval that may come."""
    situation = _situation(config, servo)
    period = situation.period
    # In the same process on the simulated clock a sample has no age.
    ages_ns = [0] if simulated and not servo.facts.has_bus else _ages_ns(config, servo)
    least_ns = round(config.guard.sample_age * 1e9)
    ages_ns = [max(age, least_ns) for age in ages_ns]
    intervals_ns = interval_bins_ns(config.period_ns)
    decisions = []
    for interval in (each * 1e-9 for each in intervals_ns):
        inserted = inserted_delay(config.delay.steps, period, interval)
        decisions.append(
            decide(
                config.request(),
                settings_at(config, interval),
                replace(situation, period=interval),
                [inserted + age * 1e-9 for age in ages_ns],
                inserted,
                explained=False,
            )
        )
    window = max(1, round(config.guard.window_s / period))
    run = max(RUN, round(RUN_S / period))
    percentile = config.guard.delay_percentile
    return GainSchedule(decisions, ages_ns, intervals_ns, percentile, window, run)


def decision_in_force(config: Config, servo: Servo, schedule: GainSchedule) -> Decision:
    """The schedule's present decision, with the reasons that the schedule leaves out."""
    decision = schedule.decision
    situation = replace(_situation(config, servo), period=decision.period)
    inserted = inserted_delay(config.delay.steps, config.period_ns * 1e-9, decision.period)
    delays = [inserted + schedule.age_ns * 1e-9]
    settings = settings_at(config, decision.period)
    (again,) = decide(config.request(), settings, situation, delays, inserted)
    return replace(decision, reasons=again.reasons)


def settings_at(config: Config, interval: float) -> GuardSettings:
    """How cautious the guard is where a tick happens once in ``interval`` [s]."""
    settings = config.guard_settings()
    if interval <= config.period_ns * 1e-9:
        return settings
    return replace(settings, damping_cap=IRREGULAR_CAP * settings.damping_cap)


def _situation(config: Config, servo: Servo) -> Situation:
    return Situation(
        belief=config.belief(),
        period=config.period_ns * 1e-9,
        torque_limit=servo.facts.torque_limit,
        position_step=servo.facts.position_step,
        slow_replies=servo.facts.reply_s > 0.0,
    )


def _watch(config: Config, servo: Servo, law: Law) -> Watch:
    """What notices an oscillation. A program is only watched; without a guard an alarm trips."""
    belief = config.belief()
    gain = belief.torque_gain.value  # torques are counted as they are commanded
    answer: Answer = config.safety.on_oscillation
    if config.guard.mode == "off":
        answer = "trip"
    return Watch(
        WatchSettings(
            detector=DetectorSettings(
                period=config.period_ns * 1e-9,
                inertia=belief.inertia.value / gain,
                damping=belief.damping.value / gain,
                coulomb=belief.coulomb.value / gain,
                position_step=servo.facts.position_step,
                torque_limit=servo.facts.torque_limit,
            ),
            answer=answer if law.guarded else "report",
            lag=belief.delay.value,
            inserted=config.delay.steps * config.period_ns * 1e-9,
            patient=law.guarded and config.wall.passivity_control,
            side=SIGNS[config.wall.side],
        )
    )


def most_injected(config: Config, servo: Servo, schedule: GainSchedule) -> list[float]:
    """Damping that may be added to each decision's [N·m·s/rad].

    Up to the peak of the boundary, beyond which more of it lowers the critical stiffness, and to
    what one encoder count may command. None where the wall is to be passive: any damping that is
    added lowers the stiffness up to which it is.
    """
    decisions = schedule.decisions
    if config.guard.mode == "passive":
        return [0.0] * len(decisions)
    situation = _situation(config, servo)
    delays = np.array([decision.delay for decision in decisions])
    periods = np.array([decision.period for decision in decisions])
    at = Plants.at_corner(situation, delays - situation.belief.delay.high)
    samples = config.wall.velocity_samples
    best = peak(at.inertia, at.damping, periods, at.delay, samples).virtual_damping / at.gain
    if step := situation.position_step:
        share = config.guard.quantisation_share * situation.torque_limit
        best = np.minimum(best, share * samples * periods / step)
    asked = np.array([decision.damping for decision in decisions])
    most: list[float] = np.maximum(best - asked, 0.0).tolist()
    return most


def _ages_ns(config: Config, servo: Servo) -> list[int]:
    return age_bins_ns(config.period_ns, round(servo.facts.reply_s * 1e9))


def rendered(config: Config, servo: Servo, program: Sequence[Phase]) -> Law:
    """The wall, which the guard will set, or what an experiment wants in its place."""
    if program:
        return Program(program, config.period_ns * 1e-9, servo.facts.torque_limit)
    return Wall(0.0, 0.0, config.wall.position, config.wall.side)


def tick_parts(
    config: Config,
    clock: Clock,
    servo: Servo,
    telemetry: Telemetry,
    schedule: GainSchedule,
    law: Law,
    injected: Sequence[float],
) -> TickParts:
    """All parts of a tick.

    Args:
        config: The effective configuration.
        clock: What the loop runs on.
        servo: Opened, and started if it is to have found out its limits.
        telemetry: Where rows go.
        schedule: The guard's decisions.
        law: What is rendered.
        injected: ``most_injected`` of the schedule.
    """
    period_ns = config.period_ns
    period = period_ns * 1e-9
    wall, safety = config.wall, config.safety
    return TickParts(
        clock=clock,
        servo=servo,
        wall=law,
        velocity=velocity_estimator(period, wall.velocity_samples),
        ring=DelayRing(config.delay.steps),
        schedule=schedule,
        safety=Safety(
            SafetyLimits(
                max_speed=safety.max_speed,
                position_step=servo.facts.position_step,
                max_loss=safety.max_loss,
                loss_window=max(1, round(safety.loss_window_s / period)),
                max_losses_in_row=safety.max_losses_in_row,
            )
        ),
        missed=MissedPeriods(period_ns, safety.max_missed),
        trips_on_missed=config.realtime.profile == "strict",
        watch=_watch(config, servo, law),
        passivity=(
            PassivityControl(period, SLOWEST)
            if law.guarded and config.wall.passivity_control
            else None
        ),
        most_injected=injected,
        telemetry=telemetry,
        period_ns=period_ns,
        ramp_ticks=max(1, round(RAMP_S / period)),
        pipelined=config.servo.schedule == "pipelined",
    )


def rehearsal(
    config: Config,
    servo: Servo,
    schedule: GainSchedule,
    injected: Sequence[float],
    program: Sequence[Phase],
) -> Rehearsal:
    """The same tick once more, of parts that nobody else has.

    Args:
        config: The effective configuration.
        servo: The one that a stand-in is wanted of; nothing is asked of it.
        schedule: The guard's decisions.
        injected: ``most_injected`` of the schedule.
        program: What is rendered in place of the wall.
    """
    clock = StandInClock()
    stand_in = servo.stand_in(clock)
    law = rendered(config, stand_in, program)
    memory = Telemetry.scratch()
    parts = tick_parts(config, clock, stand_in, memory, schedule.anew(), law, injected)
    tick = Tick(parts)
    tick.wall_on()
    return Rehearsal(tick.run, clock, config.period_ns, servo.idle)
