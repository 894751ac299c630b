"""Builds what a tick works with from a configuration: wall, guard, safety, watch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from controller.delay import DelayRing
from controller.detector.oscillation import DetectorSettings
from controller.detector.watch import Answer, Watch, WatchSettings
from controller.guard.guard import Situation, decide
from controller.guard.ladder import RUN, RUN_S, GuardLadder, rung_ages_ns
from controller.guard.plants import Plants
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


def guard_ladder(config: Config, servo: Servo, simulated: bool) -> GuardLadder:
    """The guard's decisions for every sample age that may come."""
    situation = situation_of(config, servo)
    period = situation.period
    # In the same process on the simulated clock a sample has no age.
    ages_ns = [0] if simulated and not servo.facts.has_bus else _ages_ns(config, servo)
    inserted = config.delay.steps * period
    least_ns = round(config.guard.sample_age * 1e9)
    ages_ns = [max(age, least_ns) for age in ages_ns]
    decisions = decide(
        config.request(),
        config.guard_settings(),
        situation,
        [inserted + age * 1e-9 for age in ages_ns],
        inserted,
    )
    window = max(1, round(config.guard.window_s / period))
    run = max(RUN, round(RUN_S / period))
    return GuardLadder(decisions, ages_ns, config.guard.delay_percentile, window, run)


def situation_of(config: Config, servo: Servo) -> Situation:
    """What the wall is rendered on: the belief, the period, the servo's limits."""
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


def most_injected(config: Config, servo: Servo, ladder: GuardLadder) -> list[float]:
    """Damping that may be added to each decision's [N·m·s/rad].

    Up to the peak of the boundary, beyond which more of it lowers the critical stiffness, and to
    what one encoder count may command. None where the wall is to be passive: any damping that is
    added lowers the stiffness up to which it is.
    """
    if config.guard.mode == "passive":
        return [0.0] * len(ladder.decisions)
    situation = situation_of(config, servo)
    delays = np.array([decision.delay for decision in ladder.decisions])
    at = Plants.at_corner(situation, delays - situation.belief.delay.high)
    samples = config.wall.velocity_samples
    best = peak(at.inertia, at.damping, at.period, at.delay, samples).virtual_damping / at.gain
    if step := situation.position_step:
        share = config.guard.quantisation_share * situation.torque_limit
        best = np.minimum(best, share * samples * situation.period / step)
    asked = np.array([decision.damping for decision in ladder.decisions])
    most: list[float] = np.maximum(best - asked, 0.0).tolist()
    return most


def _ages_ns(config: Config, servo: Servo) -> list[int]:
    return rung_ages_ns(config.period_ns, round(servo.facts.reply_s * 1e9))


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
    ladder: GuardLadder,
    law: Law,
    injected: Sequence[float],
) -> TickParts:
    """All parts of a tick.

    Args:
        config: The effective configuration.
        clock: What the loop runs on.
        servo: Opened, and started if it is to have found out its limits.
        telemetry: Where rows go.
        ladder: The guard's decisions.
        law: What is rendered.
        injected: ``most_injected`` of the ladder.
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
        ladder=ladder,
        safety=Safety(
            SafetyLimits(
                max_speed=safety.max_speed,
                position_step=servo.facts.position_step,
                max_loss=safety.max_loss,
                loss_window=max(1, round(safety.loss_window_s / period)),
                max_losses_in_row=safety.max_losses_in_row,
            )
        ),
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
    ladder: GuardLadder,
    injected: Sequence[float],
    program: Sequence[Phase],
) -> Rehearsal:
    """The same tick once more, of parts that nobody else has.

    Args:
        config: The effective configuration.
        servo: The one that a stand-in is wanted of; nothing is asked of it.
        ladder: The guard's decisions.
        injected: ``most_injected`` of the ladder.
        program: What is rendered in place of the wall.
    """
    clock = StandInClock()
    stand_in = servo.stand_in(clock)
    law = rendered(config, stand_in, program)
    memory = Telemetry.scratch()
    parts = tick_parts(config, clock, stand_in, memory, ladder.anew(), law, injected)
    tick = Tick(parts)
    tick.wall_on()
    return Rehearsal(tick.run, clock, config.period_ns, servo.idle)
