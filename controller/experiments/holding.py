"""Computes a spring, with its damper, that is stable with any servo within the parameter bounds.

Experiments use it to bring the shaft back and to move it. It must be stable at the longest delay
and gentle on a coarse encoder; its exact stiffness matters little.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping

_MARGIN = 0.4
"""Fraction of the critical stiffness."""
_CEILING = 0.5
"""Fraction of the damping ceiling."""
_STEP_SHARE = 0.02
"""Fraction of the torque limit that one encoder count may command, by spring and by damper each."""
_DAMPINGS = 40


@dataclass(frozen=True, slots=True)
class Hold:
    """A spring and a damper that are stable for the whole belief."""

    stiffness: float
    """[N·m/rad]"""
    damping: float
    """[N·m·s/rad]"""


def hold_of(config: Config, torque_limit: float, delay_steps: int) -> Hold:
    """Return the stiffest such spring with a suitable damper.

    Args:
        config: The effective configuration.
        torque_limit: [N·m].
        delay_steps: Periods inserted.
    """
    belief, period = config.belief(), config.period_s
    gain = belief.torque_gain.high
    inertia, damping = belief.inertia.low / gain, belief.damping.low / gain
    delay = delay_steps * period + sample_age(config) + belief.delay.high
    samples = config.wall.velocity_samples
    step = config.servo.position_step
    highest = _CEILING * float(max_virtual_damping(inertia, damping, period, delay, samples))
    stiffest = np.inf
    if step:
        highest = min(highest, _STEP_SHARE * torque_limit * period / step)
        stiffest = _STEP_SHARE * torque_limit / step
    dampings = np.linspace(0.0, highest, _DAMPINGS)
    limits = _MARGIN * critical_stiffness(inertia, damping, dampings, period, delay, samples)
    limits = np.minimum(limits, stiffest)
    best = int(np.argmax(limits))
    return Hold(float(limits[best]), float(dampings[best]))


def sample_age(config: Config) -> float:
    """Return the age of a sample to assume before a measurement [s]."""
    if config.servo.kind == "simulated":
        expected = 0.0 if config.loop.clock == "simulated" else 0.5
    else:
        expected = 2.0 if config.servo.schedule == "pipelined" else 1.0
    return max(expected * config.period_s, config.guard.sample_age)


def without_hand(config: Config) -> Config:
    """Return the configuration without a scripted operator, which would disturb an experiment."""
    if config.servo.hand == "none" or config.servo.kind == "hardware":
        return config
    return changed(config, servo={"hand": "none"})


def changed(config: Config, **sections: Mapping[str, Any]) -> Config:
    """Return the configuration with other values in some sections."""
    raw = config.model_dump(mode="json")
    for name, values in sections.items():
        raw[name] |= values
    return Config.model_validate(raw)


def torque_limit_of(config: Config) -> float:
    """Return the torque limit for planning an experiment [N·m].

    Raises:
        UserError: A real servo's is not configured.
    """
    limit = config.servo.torque_limit
    if limit is not None:
        return limit
    if config.servo.kind == "hardware":
        raise UserError(
            "found none",
            field="servo.torque_limit",
            wanted="the largest torque that the experiment may plan with [N·m]",
            advice="set it, to the stall torque at most",
        )
    return config.true_servo().torque_limit
