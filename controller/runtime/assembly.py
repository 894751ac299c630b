"""Builds an axis from a configuration: law, guard's decisions, safety, oscillation watch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from haptic_wall.controller.detector.backstop import Shared
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.guard.bins import Bins
from haptic_wall.controller.guard.plants import Plants
from haptic_wall.controller.guard.schedule import (
    RUN,
    RUN_S,
    Allowed,
    GainSchedule,
    GainTable,
    age_bins_ns,
    interval_bins_ns,
)
from haptic_wall.controller.guard.types import Decision, Situation
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.laws.delay import DelayRing
from haptic_wall.controller.laws.engagement import REST_S, Engagement, engage_torque
from haptic_wall.controller.laws.passivity_control import PassivityControl
from haptic_wall.controller.laws.program import Phase, Program
from haptic_wall.controller.laws.velocity import Biquad, velocity_estimator
from haptic_wall.controller.laws.wall import SIGNS, Law
from haptic_wall.controller.runtime.axis import Axis
from haptic_wall.controller.runtime.changeover import Changeover
from haptic_wall.controller.runtime.checks import REFUSALS, Safety, SafetyLimits, speed_limits
from haptic_wall.controller.runtime.gains import Gains
from haptic_wall.controller.runtime.handover import Inbox, KnownServo
from haptic_wall.controller.runtime.telemetry import Telemetry
from haptic_wall.controller.settings.config import MOST_KICK, Config
from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.controller.theory.boundary import chain_peak
from haptic_wall.controller.theory.chain import one_mass
from haptic_wall.hw.errors import UnfitServoError
from haptic_wall.hw.servo import WHOLE, Facts

RAMP_S = 0.05
"""Duration of a ramp to a lower stiffness [s]; a step would be felt as a knock."""
AGE_PERCENTILE = 90.0
"""Percentile of the sample ages in a window that counts as delay [%]"""
AGE_WINDOW_S = 1.0
"""That window [s]"""
_BEFORE = 0.999
"""Fraction of a damping from which the critical stiffness must still rise to it"""
SLOWEST = 0.05
"""Least speed in passivity control's division by the speed [rad/s]"""


def gain_table(config: Config, bins: Bins) -> GainTable:
    """Return the guard's numbers of each bin, as ``Bins.decide`` orders them."""
    decisions = bins.decide()
    most = most_injected(config, bins.situation, decisions)
    return GainTable(
        Allowed(each.stiffness, each.damping, each.delay, each.damping_ceiling, injected)
        for each, injected in zip(decisions, most, strict=True)
    )


def bins_of(
    config: Config,
    servo: KnownServo,
    *,
    program: bool = False,
    work: Work | None = None,
) -> Bins:
    """Return the bins of sample age and served interval that the guard decides for.

    Args:
        config: The effective configuration.
        servo: The servo, opened.
        program: A program is rendered, whose values the guard does not change. On the simulated
            clock, in the same process, only the period itself is decided for.
        work: What was evaluated before for the same run; None: nothing.
    """
    situation = situation_of(config, servo)
    intervals_ns = interval_bins_ns(config.period_ns, situation.belief.is_flexible)
    # A servo in the same process: samples have zero age.
    inside = config.loop.clock == "simulated" and servo.traffic is None
    least_ns = round(config.guard.sample_age * 1e9)
    ages_ns = [0] if inside else age_bins_ns(config.period_ns, least_ns)
    if inside and program:
        intervals_ns = intervals_ns[:1]
    ages_ns = [max(age, least_ns) for age in ages_ns]
    request, settings = config.request(situation.position_step), config.guard_settings()
    asked = (request, settings, situation, config.delay.steps, ages_ns, intervals_ns)
    return Bins(*asked, Work() if work is None else work)


def situation_of(config: Config, servo: KnownServo) -> Situation:
    """Return the situation of the wall: the belief, the period, the limits of the servo.

    All axes of a run count the longest delay of any: with their own, some arms are unstable.
    """
    belief = config.belief()
    return Situation(
        belief=belief if servo.lag is None else replace(belief, delay=servo.lag),
        period=config.period_ns * 1e-9,
        torque_limit=servo.facts.torque_limit,
        position_step=servo.facts.position_step,
    )


def most_injected(
    config: Config, situation: Situation, all_decisions: list[Decision]
) -> list[float]:
    """Return the damping that passivity control may add to each decision's [N·m·s/rad].

    It reaches to the peak of the boundary, beyond which more damping lowers the critical stiffness,
    and to the amount that one encoder count may command. With a load that vibrates it also stays
    below the ceiling: the damper takes energy out of the motion that the encoder sees, but its late
    torque at the motor feeds the vibration. It is zero where the wall must be passive:
    any added damping lowers the passive stiffness; and without passivity control.
    """
    if config.guard.mode == "passive" or not config.wall.passivity_control:
        return [0.0] * len(all_decisions)
    shared = {id(decision): decision for decision in all_decisions}
    decisions = [*shared.values()]
    delays = np.array([decision.delay for decision in decisions])
    periods = np.array([decision.period for decision in decisions])
    at = Plants.at_corner(situation, delays - situation.belief.delay.high)
    samples = config.wall.velocity_samples
    best = np.array([decision.encoder_damping for decision in decisions])
    if situation.belief.is_flexible:
        ceilings = np.array([decision.damping_ceiling for decision in decisions])
        best = np.minimum(best, config.guard.damping_cap * ceilings)
    # The search for a peak takes long with heavy friction: only where it lies below these bounds.
    tried = at.gain * np.where(np.isfinite(best), best, 0.0)
    less, more = (
        critical_stiffness(at.inertia, at.damping, share * tried, periods, at.delay, samples)
        for share in (_BEFORE, 1.0)
    )
    some = np.flatnonzero((more <= less) | ~np.isfinite(best))
    if some.size:
        m, b, g, t_d = (each[some] for each in (at.inertia, at.damping, at.gain, at.delay))
        top = chain_peak(one_mass(m, b)[0], periods[some], t_d, samples)
        best[some] = np.minimum(best[some], top.virtual_damping / g)
    asked = np.array([decision.damping for decision in decisions])
    most = dict(zip(shared, np.maximum(best - asked, 0.0).tolist(), strict=True))
    return [most[id(decision)] for decision in all_decisions]


def clip_of(config: Config, facts: Facts) -> float:
    """Return the clip of the law's torque, rounded down to a torque of the servo [N·m].

    Raises:
        UnfitServoError: It allows the servo no torque.
    """
    clip = config.wall.torque_clip
    if clip is None:
        return math.inf
    if clip < facts.torque_step * (1.0 - WHOLE):
        raise UnfitServoError(
            advice="raise it above that.",
            field="wall.torque_clip",
            given=f"is {clip:g} N·m, but the smallest torque of the {facts.name} is "
            f"{facts.torque_step:.2g} N·m",
        )
    return facts.within(clip)


def law_of(config: Config, facts: Facts) -> Law:
    """Return the law to render, with stiffness and damping 0.

    Raises:
        ConfigError: The encoder does not resolve the law.
        UnfitServoError: See ``clip_of``.
    """
    law = config.law(facts.position_step)
    law.clip = clip_of(config, facts)
    return law


def watch_settings(config: Config, facts: Facts, law: Law) -> WatchSettings:
    """Return the settings of the watch.

    A program is only watched, without a reaction; without a guard an alarm trips.

    Args:
        config: The effective configuration.
        facts: Facts of the servo.
        law: The rendered law.
    """
    belief, limit = config.belief(), min(facts.torque_limit, law.clip)
    answer, period = config.safety.on_oscillation, config.period_ns * 1e-9
    if config.guard.mode == "off":
        answer = "trip"
    return WatchSettings(
        period=period,
        position_step=facts.position_step,
        answer=answer if law.guarded else "report",
        side=SIGNS[config.wall.acting_side],
        light=belief.inertia.low / belief.torque_gain.high,  # torques are in commanded units
        heavy=belief.inertia.high / belief.torque_gain.low,
        lag=belief.delay.value,
        torque_limit=limit,
        rest_torque=engage_torque(config.safety.engage_torque, facts.stall_torque),
        passive=law.guarded and config.wall.passivity_control,
        elongation=None if law.linear else law.elongation,
    )


def assembled(
    config: Config,
    servo: KnownServo,
    telemetry: Telemetry,
    inbox: Inbox,
    shared: Shared,
    bins: Bins,
    table: GainTable,
    program: Sequence[Phase],
) -> Axis:
    """Return the axis of a servo, with all of its parts.

    Args:
        config: The effective configuration.
        servo: The servo, started if its limits come from the device.
        telemetry: Destination of the rows.
        inbox: Changes of the running wall.
        shared: What the watches of all axes share.
        bins: The bins that the guard has decided for.
        table: Its numbers of each.
        program: Rendered in place of the configuration's law; empty: none is.
    """
    period_ns = config.period_ns
    period = period_ns * 1e-9
    facts, wall, safety, kick = servo.facts, config.wall, config.safety, config.servo.kick
    law: Law = Program(program, period, facts.torque_limit) if program else law_of(config, facts)
    schedule = GainSchedule(
        table,
        bins.ages_ns,
        bins.intervals_ns,
        AGE_PERCENTILE,
        max(1, round(AGE_WINDOW_S / period)),
        max(RUN, round(RUN_S / period)),
    )
    belief = config.belief()
    gain = belief.torque_gain.high
    real = config.servo.kind == "hardware"
    fastest, driven = speed_limits(safety.max_speed, facts, real)
    if not (law.guarded or real):
        driven = math.inf  # a program may drive a simulated shaft
    filtered = config.velocity_filter()
    gains = Gains(schedule, law, max(1, round(RAMP_S / period)))
    rest_torque = engage_torque(safety.engage_torque, facts.stall_torque)
    return Axis(
        law=law,
        velocities=velocity_estimator(period, wall.velocity_samples),
        velocity_filter=None if filtered is None else Biquad(filtered.taps()),
        gains=gains,
        ring=DelayRing(config.delay.steps),
        safety=Safety(
            SafetyLimits(
                max_speed=fastest,
                position_step=facts.position_step,
                max_loss=safety.max_loss,
                loss_window=max(1, round(safety.loss_window_s / period)),
                max_silence_ns=round(safety.max_silence_s * 1e9),
                period_ns=period_ns,
                refusals=0 if servo.traffic is None else REFUSALS,
                # In the other profiles they only lower stiffness and damping.
                max_missed=safety.max_missed if config.realtime.profile == "strict" else math.inf,
                travel=safety.travel or (-math.inf, math.inf),
                travel_from_start=wall.reference == "start",
                driven_speed=driven,
                torque_limit=facts.torque_limit,
                inertia=belief.inertia.low / gain,
                damping=belief.damping.low / gain,
                coulomb=belief.coulomb.low / gain,
                kicked=kick is not None and abs(kick) <= MOST_KICK,
            )
        ),
        watch=Watch(watch_settings(config, facts, law), shared),
        passivity=(
            PassivityControl(period, SLOWEST)
            if law.guarded and config.wall.passivity_control
            else None
        ),
        telemetry=telemetry,
        period_ns=period_ns,
        torque_limit=facts.torque_limit,
        wall_from_start=law.guarded and wall.reference == "start",
        engagement=Engagement(
            torque=rest_torque,
            position_step=facts.position_step,
            periods=max(1, math.ceil(REST_S / period - 1e-6)),
            # A program comes on wherever the shaft is: it starts there.
            start_room=config.start_room if law.guarded else math.inf,
        ),
        inbox=inbox,
        changeover=Changeover(rest_torque, facts.torque_limit, period),
        sign=config.servo.sign,
        offset=config.servo.offset,
    )
