"""The speeds between which a wall that never pulls returns no device faster than it came.

Below its limit such a wall takes energy from every contact, in proportion to the square of the
speed. Two things break the proportion. One encoder count commands a torque of its own: the work
of that error grows with the speed itself, so at low speeds it is more than the contact takes. And
at high speeds the torque reaches its limit, which is another wall.

**The low end.** Along a contact the torque differs from the ideal wall's by no more than one
count's torque, e = g (K q + |B| q / (N T)). Over a depth v/w that is a work of about 2 e v / w
against a loss of (1 - r²) m v² / 2, with r the ideal restitution and w = sqrt(g K / m). So the
contact loses energy above a speed of the order of e / (m w (1 - r)). That argument gives where to
look, not the number: from there downwards contacts are simulated with counts, over phases of entry
and places of the surface within a count, until counts take half of what the contact loses: single
speeds lie above their neighbours, so the ones tried must not come close to 1. Coulomb friction c
does the work -2 c v / w on the same way, so with it the speed is (1 - c / e) times that, and none
is left where friction is as strong as one count. (The true one is often far lower, but jagged:
with friction single speeds come back faster where their neighbours do not.)

**The high end** is proved. On the way in the device is never faster than at the entry, and after
the lag t_d + T the torque is at least the spring's at the place of a lag ago. So it goes no deeper
than v (t_d + T + 1/w), no torque of the law is above K times that plus B times the measured speed,
and one count adds its own. On the way out the damper only takes away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.one_sided import restitution
from haptic_wall.controller.theory.rounded_contact import RoundedContacts, returned_speed

_STEP, _SPEEDS = 1.16, 40  # between two speeds that are tried, and how many: down to 1/330
_DAMPER_ALONE = 4.0
_PHASES = np.linspace(0.0, 1.0, 7)
_FIRSTS = np.array([0.02, 0.5, 1.0])  # where the surface lies in its count
_FROM = 4.0  # times the speed of the energy argument: where the search begins
_DAMPER_ALONE = 4.0  # times one count's impulse, times the periods it acts late
_SIMULATED = 2000.0  # periods; a longer contact is not simulated, the search's beginning is taken
BETWEEN = 1.25
"""On top of the highest speed found, for what lies between those that are tried
(`scripts/rebound_table` searches for contacts that break it)."""


@dataclass(frozen=True, slots=True)
class Servos:
    """Servos with a wall on them, arrays of one length, in SI units."""

    inertia: FloatArray
    damping: FloatArray
    gain: FloatArray
    delay: FloatArray


@dataclass(frozen=True, slots=True)
class OneSidedWall:
    """A wall that never pulls, as commanded, and what renders it; SI units."""

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
        """Torque commanded by one encoder count [N·m]."""
        by_damper = abs(self.damping) / (self.velocity_samples * self.period)
        return self.position_step * (self.stiffness + by_damper)


def never_faster(wall: OneSidedWall, servos: Servos) -> bool:
    """Whether the ideal wall, without counts or saturation, returns no device faster.

    Args:
        wall: The wall.
        servos: Every one of them must hold.
    """
    if _longest(wall, servos) > _SIMULATED:
        return True  # a spring so soft is outweighed by any friction
    return bool(np.all(_restitution(wall, servos) <= 1.0))


def lowest_speed(wall: OneSidedWall, servos: Servos, friction: float) -> float | None:
    """Entry speed above which counts make no contact return the device faster [rad/s].

    Args:
        wall: The wall; its torque limit plays no part.
        servos: The speed is the highest of them.
        friction: Coulomb friction that acts at least [N·m].

    Returns:
        None where there is none: friction takes at every speed what counts give, or the position
        is exact.
    """
    if wall.position_step == 0 or wall.count_torque == 0:
        return None
    s = servos
    # friction takes its part of the work of one count's torque
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
        # nothing turns the device but what single counts command before they act
        return left * float(np.max(_DAMPER_ALONE * count * late) * unit)
    lost = _lost(wall, s)
    top = _FROM * float(np.max(count * np.maximum(late, 1.0 / np.sqrt(alpha)) / lost))
    if _longest(wall, s) > _SIMULATED:
        return left * top * unit
    speeds = top * _STEP ** -np.arange(_SPEEDS, dtype=np.float64)
    taken = np.flatnonzero(_worst(wall, s, speeds, 1.0 - 0.5 * lost) > 0.0)
    return left * float(speeds[taken[0] if taken.size else -1]) * BETWEEN * unit


def highest_speed(wall: OneSidedWall, servos: Servos, friction: float) -> float:
    """Entry speed up to which the torque stays within its limit during a contact [rad/s].

    Args:
        wall: The wall.
        servos: The speed is the lowest of them.
        friction: Coulomb friction that acts at most [N·m]; it has slowed the device down before
            the entry, and the damper sees the speed before.

    Returns:
        0 where one encoder count saturates the torque already.
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
    """By how much friction makes the measured speed higher than the speed at the wall [rad/s].

    The velocity is a mean over N periods, in which friction has slowed the device down.
    """
    span = wall.velocity_samples * wall.period
    slowed: FloatArray = friction * span / s.inertia * np.exp(s.damping * span / s.inertia)
    return slowed


def _longest(wall: OneSidedWall, s: Servos) -> float:
    """How long a contact lasts at most [periods]; infinite without a spring."""
    if wall.stiffness == 0:
        return np.inf
    return float(np.pi / wall.period * np.max(np.sqrt(s.inertia / (s.gain * wall.stiffness))))


def _lost(wall: OneSidedWall, s: Servos) -> FloatArray:
    """Share of the speed that an ideal contact takes, 0.001 at least."""
    if _longest(wall, s) > _SIMULATED:
        # with hardly any stiffness it is what the two dampings take, half of the second one's
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
    """Greatest excess over the ratio allowed of each servo, at each speed; no friction."""
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
