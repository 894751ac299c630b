"""Announces a commissioning's motions before it starts: distance, torque and duration."""

from __future__ import annotations

import math
from dataclasses import dataclass

from haptic_wall.controller.experiments import delay as loop_delay
from haptic_wall.controller.experiments.commission.sweep_points import OPTIONS, short_sweep
from haptic_wall.controller.experiments.holding import torque_limit_of, without_hand
from haptic_wall.controller.experiments.identify.identification import (
    SECONDS,
    announcement,
    bounds_of,
)
from haptic_wall.controller.experiments.sweep.sweep import excursion, expected_s
from haptic_wall.controller.settings.config import Config

DELAY_STEPS = (0, 5)
"""Inserted periods, in addition to the configured ones, that must be recovered"""
_DOCTOR_S = 20.0
_SWEEP_S = 200.0
"""Approximate duration of the sweep: a simulated servo needs no person beside it, so it is not
planned exactly [s]"""


@dataclass(frozen=True, slots=True)
class Announcement:
    """The planned steps, in words."""

    lines: tuple[str, ...]
    """One for each step"""
    seconds: float
    """In real time, approximately"""


def has_doctor(config: Config) -> bool:
    """Whether there is a bus in real time that can be examined."""
    return config.servo.kind != "simulated" and config.loop.clock == "monotonic"


def announce(config: Config, reach: float) -> Announcement:
    """Return the planned motions of a commissioning on the servo of a configuration.

    Args:
        config: Before the identification.
        reach: Largest excursion during the identification [rad].

    Raises:
        UserError: The reach is invalid, or no torque limit is known.
    """
    bounds = bounds_of(config, reach)
    limit = torque_limit_of(config)
    lines, seconds = [], SECONDS
    if has_doctor(config):
        lines.append("doctor: nothing moves, no torque is enabled")
        seconds += _DOCTOR_S
    else:
        lines.append("doctor: left out, because there is no bus to examine")
    lines.append(f"identify: {announcement(bounds)}")
    runs = 1 + len(DELAY_STEPS)
    lines.append(f"delay: the same motions in {runs} runs, with periods inserted")
    seconds += loop_delay.START_S + runs * loop_delay.RUN_S
    if config.loop.clock == "simulated":
        lines.append("sweep: the shaft is released at a few settings, at rising stiffness")
        return Announcement(tuple(lines), seconds + _SWEEP_S)
    swept = without_hand(config)
    settings = short_sweep(swept)
    far = excursion(swept, settings, OPTIONS)
    lines.append(
        f"sweep: the shaft is released at {len(settings)} settings, at rising stiffness, and swings"
        f" by at most about {far:.2g} rad ({math.degrees(far):.0f}°) to each side, with torques of"
        f" up to {limit:.3g} N·m (the result of identify changes this plan)"
    )
    seconds += expected_s(swept, settings, OPTIONS)
    return Announcement(tuple(lines), seconds)
