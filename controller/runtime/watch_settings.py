"""Derives the settings of the oscillation watch from a configuration and the servo's facts."""

from __future__ import annotations

from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.laws.engagement import engage_torque
from haptic_wall.controller.laws.wall import SIGNS, Law
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.servo import Facts


def watch_settings(config: Config, facts: Facts, law: Law) -> WatchSettings:
    """Return the settings of the watch.

    A program is only watched, without a reaction; without a guard an alarm trips.

    Args:
        config: The effective configuration.
        facts: Facts of the servo.
        law: The rendered law.
    """
    belief, limit = config.belief(), min(facts.torque_limit, law.clip)
    answer = config.safety.on_oscillation
    if config.guard.mode == "off":
        answer = "trip"
    return WatchSettings(
        period=config.period_ns * 1e-9,
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
