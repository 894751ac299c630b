"""Plans a commissioning: announces its motions, and chooses the points of its short sweep.

The points are chosen so that the torque limit allows their kicks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from haptic_wall.controller.experiments.holding import (
    sample_age,
    torque_limit_of,
    without_hand,
)
from haptic_wall.controller.experiments.identify.identification import (
    SECONDS,
    announcement,
    bounds_of,
)
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.experiments.sweep.plan import Options, PlanePoint, reach
from haptic_wall.controller.experiments.sweep.sweep import excursion, expected_s
from haptic_wall.controller.settings.config import Config

OPTIONS = Options(kick=None, tolerance=0.02)
_MORE = 3
"""Periods inserted in addition to the configured ones: the fit of the boundary's line needs a
second delay"""
_SHARES = (0.0, 1.0 / 3.0, 2.0 / 3.0)
"""Fractions of the useful virtual damping"""
_CEILING = 0.5
"""Largest useful fraction of the ceiling: beyond it stiffness falls again"""
_ROOM = 0.9
"""Fraction of the stiffest wall within the torque limit at which a point is planned"""
_HALVINGS = 3
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


def announce(config: Config, far: float) -> Announcement:
    """Return the planned motions of a commissioning on the servo of a configuration.

    Args:
        config: Before the identification.
        far: Largest excursion during the identification [rad].

    Raises:
        UserError: The reach is invalid, or no torque limit is known.
    """
    bounds = bounds_of(config, far)
    limit = torque_limit_of(config)
    lines, seconds = [], SECONDS
    if has_doctor(config):
        lines.append("doctor: nothing moves, no torque is enabled")
        seconds += _DOCTOR_S
    else:
        lines.append("doctor: left out, because there is no bus to examine")
    lines.append(f"identify: {announcement(bounds)}")
    if config.loop.clock == "simulated":
        lines.append("sweep: the shaft is released at a few settings, at rising stiffness")
        return Announcement(tuple(lines), seconds + _SWEEP_S)
    swept = without_hand(config)
    settings = short_sweep(swept)
    swing = excursion(swept, settings, OPTIONS)
    lines.append(
        f"sweep: the shaft is released at {len(settings)} settings, at rising stiffness, and swings"
        f" by at most about {swing:.2g} rad ({math.degrees(swing):.0f}°) to each side, with torques"
        f" of up to {limit:.3g} N·m (the result of identify changes this plan)"
    )
    seconds += expected_s(swept, settings, OPTIONS)
    return Announcement(tuple(lines), seconds)


def short_sweep(config: Config) -> tuple[PlanePoint, ...]:
    """Return points at 0, 1/3 and 2/3 of the largest useful virtual damping, at two delays.

    The largest useful damping is the smallest of three: half the ceiling; the damping at which one
    encoder count commands ``guard.quantisation_share`` of the torque limit; the damping at which
    the kick that shows an oscillation would exceed the torque limit.

    Args:
        config: Configuration with the best known model of the servo.
    """
    device, own = Device.of(config), config.delay.steps
    tops = {steps: _sensible(config, device, steps) for steps in (own, own + _MORE)}
    points = (
        PlanePoint(float(f"{share * top:.3g}"), steps)
        for steps, top in tops.items()
        for share in _SHARES
    )
    return tuple(dict.fromkeys(points))


def _sensible(config: Config, device: Device, steps: int) -> float:
    """Return the largest useful virtual damping at an inserted delay [N·m·s/rad]."""
    # A sample may be younger than assumed, and the limit then higher.
    delay = steps * device.period + device.lag
    top = _CEILING * device.loop.ceiling(delay + sample_age(config))
    if device.position_step:
        share = config.guard.quantisation_share * device.torque_limit
        top = min(top, share * device.loop.samples * device.period / device.position_step)
    if _has_room(device, top, steps, delay) or not _has_room(device, 0.0, steps, delay):
        return top  # in the second case no damping helps, and the sweep reports it
    low = 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + top)
        low, top = (middle, top) if _has_room(device, middle, steps, delay) else (low, middle)
    return low


def _has_room(device: Device, damping: float, steps: int, delay: float) -> bool:
    # The largest of the measured fractions must be possible.
    setting = PlanePoint(_SHARES[-1] * damping, steps)
    if device.exact(setting.virtual_damping, delay) <= 0.0:
        return False
    planned = reach(device, setting, delay, OPTIONS.kick)
    return planned.predicted <= _ROOM * planned.top
