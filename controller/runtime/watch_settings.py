"""Derives the settings of the oscillation watch from a configuration and the servo's facts."""

from __future__ import annotations

from typing import Protocol

from haptic_wall.controller.detector.backstop_settings import BackstopSettings, sizes
from haptic_wall.controller.detector.oscillation import DetectorSettings
from haptic_wall.controller.detector.tuning import TUNING, Tuning
from haptic_wall.controller.detector.watch import Answer, WatchSettings
from haptic_wall.controller.laws.engagement import engage_torque
from haptic_wall.controller.laws.wall import SIGNS, Law
from haptic_wall.controller.settings.config import Config


class WatchFacts(Protocol):
    """Facts of a servo that the oscillation watch needs."""

    @property
    def torque_limit(self) -> float:
        """Return the largest torque it accepts [N·m]."""

    @property
    def stall_torque(self) -> float:
        """Return the largest torque it can make [N·m]; infinite: not known."""

    @property
    def position_step(self) -> float:
        """Return one count of the encoder [rad]; 0: the position is not quantised."""

    @property
    def torque_step(self) -> float:
        """Return the unit of its torques [N·m]; 0: they are not rounded."""


def watch_settings(
    config: Config, facts: WatchFacts, law: Law, tuning: Tuning = TUNING
) -> WatchSettings:
    """Return the settings of the watch.

    A program is only watched, without a reaction; without a guard an alarm trips.

    Args:
        config: The effective configuration.
        facts: Facts of the servo.
        law: The rendered law.
        tuning: Numbers of the detector.
    """
    belief = config.belief()
    gain = belief.torque_gain.value  # torques are in commanded units
    answer: Answer = config.safety.on_oscillation
    if config.guard.mode == "off":
        answer = "trip"
    return WatchSettings(
        detector=DetectorSettings(
            period=config.period_ns * 1e-9,
            inertia=belief.inertia.value / gain,
            damping=belief.damping.value / gain,
            coulomb=belief.coulomb.value / gain,
            position_step=facts.position_step,
            torque_limit=min(facts.torque_limit, law.clip),
            torque_step=facts.torque_step,
            tuning=tuning,
        ),
        answer=answer if law.guarded else "report",
        lag=belief.delay.value,
        inserted=config.delay.steps * config.period_ns * 1e-9,
        patient=law.guarded and config.wall.passivity_control,
        side=SIGNS[config.wall.acting_side],
        backstop=_backstop(config, facts, law.clip, tuning, bounces=False) if law.guarded else None,
        bounces=_backstop(config, facts, law.clip, tuning, bounces=True),
        damping_high=belief.damping.high / belief.torque_gain.low,
        heavy=belief.inertia.high / belief.torque_gain.low,
        light=belief.inertia.low / belief.torque_gain.high,
        elongation=None if law.linear else law.elongation,
    )


def _backstop(
    config: Config, facts: WatchFacts, clip: float, tuning: Tuning, *, bounces: bool
) -> BackstopSettings | None:
    """Return when the wall is probed for self-sustained motion; ``bounces``: by its contacts."""
    if bounces and config.wall.acting_side == "both":
        return None
    belief = config.belief()
    step = facts.position_step
    threshold, small = sizes(step, tuning)
    return BackstopSettings(
        period=config.period_ns * 1e-9,
        position_step=step,
        threshold=threshold,
        small=small,
        light=tuning.backstop.lightest * belief.inertia.low / belief.torque_gain.high,
        heavy=tuning.backstop.heaviest * belief.inertia.high / belief.torque_gain.low,
        heaviest=belief.inertia.high / belief.torque_gain.low,
        rest_torque=engage_torque(config.safety.engage_torque, facts.stall_torque),
        torque_limit=min(facts.torque_limit, clip),
        acts=config.safety.on_oscillation != "report" or config.guard.mode == "off",
        bounces=bounces,
        unprobed=tuning.backstop.regular_told,
        tuning=tuning,
    )
