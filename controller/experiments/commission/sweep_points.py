"""Chooses the points of a short sweep so that the torque limit allows the kicks."""

from __future__ import annotations

from haptic_wall.controller.experiments.holding import sample_age
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.experiments.sweep.plan import Options, PlanePoint, reach
from haptic_wall.controller.settings.config import Config

OPTIONS = Options(kick=None, repeats=1, tolerance=0.02)
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


def short_sweep(config: Config) -> tuple[PlanePoint, ...]:
    """Return points at 0, 1/3 and 2/3 of the largest useful virtual damping, at two delays.

    The largest useful damping is the smallest of three: half the ceiling; the damping at which one
    encoder count commands ``guard.quantisation_share`` of the torque limit; the damping at which
    the kick that shows an oscillation would exceed the torque limit.

    Args:
        config: Configuration with the best known model of the servo.
    """
    steps = config.delay.steps
    return points_at(config, steps) + points_at(config, steps + _MORE)


def points_at(config: Config, steps: int) -> tuple[PlanePoint, ...]:
    """Return the points of ``short_sweep`` at one delay.

    Args:
        config: Configuration with the best known model of the servo.
        steps: Inserted delay [periods].
    """
    top = _sensible(config, Device.of(config), steps)
    points = (PlanePoint(float(f"{share * top:.3g}"), steps) for share in _SHARES)
    return tuple(dict.fromkeys(points))


def _sensible(config: Config, device: Device, steps: int) -> float:
    # A sample may be younger than assumed, and the limit then higher.
    delay = steps * device.period + device.lag
    top = _CEILING * device.ceiling(delay + sample_age(config))
    if device.position_step:
        share = config.guard.quantisation_share * device.torque_limit
        top = min(top, share * device.velocity_samples * device.period / device.position_step)
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
