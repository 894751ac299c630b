"""Computes the range of entry speeds at which a one-sided wall adds no speed to the device.

Below its limit such a wall takes energy in every contact, in proportion to the square of the speed.
Two effects disturb this. Each encoder count causes an error of the torque; the work of this error
is proportional to the speed, so at low speeds it exceeds the energy that the wall takes. At high
speeds the torque saturates, so that the wall is no longer the one of the theory.

**The low end.** Along a contact the torque differs from the ideal wall's by at most one count's
torque, e = g (K q + |B| q / (N T)). Over a depth v/w its work is about 2 e v / w, against a loss of
(1 - r²) m v² / 2, with r the ideal restitution and w = sqrt(g K / m). So the contact loses energy
above a speed of the order of e / (m w (1 - r)). This estimate gives the start of the search, not
the result. From there on, contacts with encoder counts are simulated at lower and lower speeds, for
several phases of entry and several positions of the surface within a count, until the counts return
half of the ideal contact's loss. The ratio of speeds is not smooth: single speeds have larger
ratios than their neighbours, so the ratios at the tried speeds must stay well below 1. Coulomb
friction c does the work -2 c v / w along the same path, so it reduces the speed by (1 - c / e);
friction as strong as one count's torque prevents every gain of speed. (The true speed is often far
lower, but jagged: with friction some single speeds return faster than their neighbours.)

**The high end** is proved. On the way in the device is never faster than at the entry, and after
the lag t_d + T the torque is at least the spring's at the position one lag earlier. So the depth is
at most v (t_d + T + 1/w), the law's torque is at most K times that plus B times the measured speed,
and one count adds its own. On the way out the damper only reduces the torque.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.one_sided import restitution
from haptic_wall.controller.theory.rounded_contact import RoundedContacts, returned_speed

_STEP, _SPEEDS = 1.16, 40  # ratio of neighbouring tried speeds, and their number: down to 1/330
_DAMPER_ALONE = 4.0
_PHASES = np.linspace(0.0, 1.0, 7)
_FIRSTS = np.array([0.02, 0.5, 1.0])  # places of the surface within its count
_FROM = 4.0  # start of the search, as a multiple of the energy estimate
_DAMPER_ALONE = 4.0  # times one count's impulse, times the periods it acts late
_SIMULATED = 2000.0  # periods; for longer contacts the result is the start of the search
BETWEEN = 1.25
"""Factor on the highest speed found, for speeds between the tried ones (chosen by a search
for contacts that break it)."""


@dataclass(frozen=True, slots=True)
class Servos:
    """Servos that render the wall, arrays of one length, in SI units."""

    inertia: FloatArray
    damping: FloatArray
    gain: FloatArray
    delay: FloatArray


@dataclass(frozen=True, slots=True)
class OneSidedWall:
    """A commanded one-sided wall with its encoder, period and torque limit; SI units."""

    stiffness: float
    damping: float
    period: float
    position_step: float
    """Encoder step [rad]; 0: the position is not quantised"""
    torque_limit: float
    """[N·m], commanded"""
    velocity_samples: int = 1

    @property
    def count_torque(self) -> float:
        """Return the torque commanded by one encoder count [N·m]."""
        by_damper = abs(self.damping) / (self.velocity_samples * self.period)
        return self.position_step * (self.stiffness + by_damper)


def never_faster(wall: OneSidedWall, servos: Servos) -> bool:
    """Whether the ideal wall, without counts or saturation, returns no device faster than it came.

    Args:
        wall: The wall.
        servos: Servos for which the condition must hold.
    """
    if _longest(wall, servos) > _SIMULATED:
        return True  # any friction outweighs a spring this soft
    return bool(np.all(_restitution(wall, servos) <= 1.0))


def lowest_speed(wall: OneSidedWall, servos: Servos, friction: float) -> float | None:
    """Return the entry speed above which encoder counts make no device return faster [rad/s].

    Args:
        wall: The wall; its torque limit has no effect.
        servos: Servos; the result is the highest of their speeds.
        friction: Least Coulomb friction that acts [N·m].

    Returns:
        The speed; None if no speed is critical, because friction takes the energy that counts give
        at every speed, or the position is exact.
    """
    if wall.position_step == 0 or wall.count_torque == 0:
        return None
    s = servos
    # friction reduces the work of one count's torque
    error = s.gain * (wall.count_torque + abs(wall.damping) * _slowed(wall, s, friction))
    greatest = float(np.max(error))
    if friction >= greatest:
        return None
    left = (greatest - friction) / (wall.count_torque * float(np.max(s.gain)))
    unit = wall.position_step / wall.period  # one count per period
    alpha = s.gain * wall.stiffness * wall.period**2 / s.inertia
    beta = s.gain * abs(wall.damping) * wall.period / s.inertia
    count = alpha + beta / wall.velocity_samples
    late = s.delay / wall.period + 1.0
    if not alpha.all():
        # only delayed single counts turn the device
        return left * float(np.max(_DAMPER_ALONE * count * late) * unit)
    lost = _lost(wall, s)
    top = _FROM * float(np.max(count * np.maximum(late, 1.0 / np.sqrt(alpha)) / lost))
    if _longest(wall, s) > _SIMULATED:
        return left * top * unit
    speeds = top * _STEP ** -np.arange(_SPEEDS, dtype=np.float64)
    taken = np.flatnonzero(_worst(wall, s, speeds, 1.0 - 0.5 * lost) > 0.0)
    return left * float(speeds[taken[0] if taken.size else -1]) * BETWEEN * unit


def highest_speed(wall: OneSidedWall, servos: Servos, friction: float) -> float:
    """Return the entry speed up to which the torque does not saturate during a contact [rad/s].

    Args:
        wall: The wall.
        servos: Servos; the result is the lowest of their speeds.
        friction: Greatest Coulomb friction that acts [N·m]. It slows the device down before the
            entry, but the velocity estimate still contains the higher speed before.

    Returns:
        The speed; 0 if one encoder count already saturates the torque.
    """
    s, t = servos, wall.period
    span = wall.velocity_samples * t
    slowed = s.damping * span / s.inertia
    faster = np.where(slowed > 0, np.expm1(slowed) / np.where(slowed > 0, slowed, 1.0), 1.0)
    virtual = max(wall.damping, 0.0)
    by_friction = virtual * faster * friction * span / s.inertia
    per_speed = wall.stiffness * (s.delay + t) + virtual * faster
    if wall.stiffness > 0:
        per_speed = per_speed + np.sqrt(wall.stiffness * s.inertia / s.gain)
    left = wall.torque_limit - wall.count_torque - by_friction
    with np.errstate(divide="ignore"):
        fastest = np.where(left > 0, left / per_speed, 0.0)
    return float(np.min(fastest))


def _slowed(wall: OneSidedWall, s: Servos, friction: float) -> FloatArray:
    """Return by how much friction makes the measured speed exceed the speed at the wall [rad/s].

    The velocity is a mean over N periods, in which friction has slowed the device down.
    """
    span = wall.velocity_samples * wall.period
    slowed: FloatArray = friction * span / s.inertia * np.exp(s.damping * span / s.inertia)
    return slowed


def _longest(wall: OneSidedWall, s: Servos) -> float:
    """Return the longest duration of a contact [periods]; infinite without a spring."""
    if wall.stiffness == 0:
        return np.inf
    return float(np.pi / wall.period * np.max(np.sqrt(s.inertia / (s.gain * wall.stiffness))))


def _lost(wall: OneSidedWall, s: Servos) -> FloatArray:
    """Return the fraction of its speed that a device loses in an ideal contact, at least 0.001."""
    if _longest(wall, s) > _SIMULATED:
        # with little stiffness the loss comes from the viscous and half of the virtual damping
        damping = s.damping + 0.5 * s.gain * max(wall.damping, 0.0)
        lost = np.minimum(0.5 * damping * _longest(wall, s) * wall.period / s.inertia, 0.5)
    else:
        lost = 1.0 - _restitution(wall, s)
    result: FloatArray = np.maximum(lost, 1e-3)
    return result


def _restitution(wall: OneSidedWall, s: Servos) -> FloatArray:
    return restitution(
        s.inertia,
        s.damping,
        s.gain * wall.stiffness,
        s.gain * wall.damping,
        wall.period,
        s.delay,
        17,
        wall.velocity_samples,
    )


def _worst(wall: OneSidedWall, s: Servos, speeds: FloatArray, allowed: FloatArray) -> FloatArray:
    """Return each servo's greatest excess over the allowed ratio at each speed, frictionless."""
    shape = (speeds.size, s.inertia.size, _PHASES.size, _FIRSTS.size)

    def of_servo(values: FloatArray) -> FloatArray:
        return np.broadcast_to(values[None, :, None, None], shape).ravel()

    t = wall.period
    count = shape[0] * shape[1] * shape[2] * shape[3]
    contacts = RoundedContacts(
        delta=of_servo(s.damping * t / s.inertia),
        alpha=of_servo(s.gain * wall.stiffness * t * t / s.inertia),
        beta=of_servo(s.gain * wall.damping * t / s.inertia),
        delay=of_servo(s.delay / t),
        samples=np.full(count, wall.velocity_samples),
        friction=np.zeros(count),
        limit=np.full(count, np.inf),
        first=np.broadcast_to(_FIRSTS, shape).ravel(),
        speed=np.broadcast_to(speeds[:, None, None, None], shape).ravel(),
        phase=np.broadcast_to(_PHASES[:, None], shape).ravel(),
    )
    excess = returned_speed(contacts) - of_servo(allowed)
    worst: FloatArray = excess.reshape(speeds.size, -1).max(axis=1)
    return worst
