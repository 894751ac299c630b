"""Simulates one contact with encoder counts, dry friction and a torque limit, on a one-sided wall.

It is ``contact`` without the idealisations that make the law homogeneous; here the ratio of the
speeds depends on the speed. Dimensionless: period 1, inertia 1, one encoder count 1. The first
count inside the wall begins at position 0; the wall's surface lies somewhere in that count. The
torque at a sample inside is ``min(limit, max(0, alpha p + beta dp))`` outwards, with p the measured
penetration and dp its N-sample difference, samples before the contact included. The motion is exact
between the switches of the torque.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.controller.theory.response import held_response

_SWEEP = 8  # periods between two checks for contacts that are over
_HALVINGS, _ENOUGH = 60, 1e-7  # steps at most, and the last one [periods]
_LONGEST = 20_000  # periods; no contact that can return speed lasts as long
_FLOOR = 0.5  # a contact that cannot return this fraction of its speed is not simulated further


@dataclass(frozen=True, slots=True)
class RoundedContacts:
    """Contacts to simulate; flat arrays of one length."""

    delta: FloatArray
    """Viscous damping b T / m"""
    alpha: FloatArray
    """Acting stiffness g K T² / m"""
    beta: FloatArray
    """Acting virtual damping g B T / m"""
    delay: FloatArray
    """Total delay in periods"""
    samples: IntArray
    """N of the velocity difference"""
    friction: FloatArray
    """Coulomb friction c T² / (m q)"""
    limit: FloatArray
    """Torque limit g tau T² / (m q); infinite for none"""
    first: FloatArray
    """Penetration measured in the first count inside [counts], 0 (excluded) to 1"""
    speed: FloatArray
    """Speed of entry, where the first count inside begins, > 0 [counts per period]"""
    phase: FloatArray
    """From the entry to the first sample inside [periods], 0 to 1"""

    def take(self, index: NDArray[np.bool_] | IntArray) -> RoundedContacts:
        """Return the contacts at ``index``."""
        return RoundedContacts(*(getattr(self, field.name)[index] for field in fields(self)))


def returned_speed(contacts: RoundedContacts) -> FloatArray:
    """Return the final exit speed over the entry speed of each contact.

    The exit speed is the greatest outward speed outside the wall until the last commanded torque
    has ended; 0 where friction holds the device inside. Below 0.5 it is a bound: such a contact is
    not simulated to its end.

    Args:
        contacts: Contacts to simulate.
    """
    c = contacts
    result = np.zeros_like(c.delta)
    place = np.arange(result.size)
    whole = np.floor(c.delay).astype(np.int64)
    part = c.delay - whole
    # all motion before the first sample is free
    motion = _Motion(np.zeros_like(c.speed), c.speed.copy(), np.zeros_like(c.speed))
    motion.advance(c, np.zeros_like(c.speed), c.phase)
    commands = np.zeros((int(whole.max(initial=0)) + 2, result.size))
    positions = np.zeros((int(c.samples.max(initial=1)) + 1, result.size))
    for back in range(1, positions.shape[0]):
        ago = held_response(c.delta, c.phase - back)
        positions[-back] = np.floor(
            ago.position_per_speed * c.speed - ago.position_per_torque * c.friction
        )
    idle = np.zeros(result.size, dtype=np.int64)  # samples without a torque that moves anything
    columns = np.arange(result.size)
    for k in range(_LONGEST):
        if not place.size:
            break
        # at phase 0 the sample falls on the edge of the count and sees it
        measured = np.floor(motion.x) if k else np.maximum(np.floor(motion.x), 0.0)
        before = positions[(k - c.samples) % positions.shape[0], columns]
        penetration = measured + c.first
        command = c.alpha * penetration + c.beta * (measured - before) / c.samples
        command = np.clip(command, 0.0, c.limit) * (penetration > 0)
        positions[k % positions.shape[0]] = measured
        commands[k % commands.shape[0]] = command
        motion.advance(c, commands[(k - 1 - whole) % commands.shape[0], columns], part)
        motion.advance(c, commands[(k - whole) % commands.shape[0], columns], 1.0 - part)
        still = (motion.x < 0) & (command == 0) | (motion.v == 0) & (command <= c.friction)
        idle = np.where(still, idle + 1, 0)
        if k % _SWEEP:
            continue
        # a commanded torque that has not acted yet counts in full
        pending = commands.sum(axis=0)
        spring = np.maximum(motion.x + c.first, 0.0)
        bound = np.sqrt(motion.v * motion.v + c.alpha * spring * spring) + pending
        slow = (motion.v <= 0) & (bound < _FLOOR * c.speed)
        over = (idle > whole + 1 + c.samples) | slow
        if not over.any():
            continue
        fastest = np.where(slow, np.maximum(motion.leaving, bound), motion.leaving)
        result[place[over]] = fastest[over] / c.speed[over]
        on = ~over
        c, place, whole, part, idle = c.take(on), place[on], whole[on], part[on], idle[on]
        motion = _Motion(motion.x[on], motion.v[on], motion.leaving[on])
        commands, positions = commands[:, on], positions[:, on]
        columns = np.arange(place.size)
    return result


@dataclass(slots=True)
class _Motion:
    """Positions and speeds of the devices, and the greatest outward speed of each outside."""

    x: FloatArray
    v: FloatArray
    leaving: FloatArray

    def advance(self, c: RoundedContacts, u: FloatArray, time: FloatArray) -> None:
        """Move under a held torque ``u`` >= 0 (outwards, towards -x) for a time [periods]."""
        inward = self.v > 0
        braking = np.where(inward, u + c.friction, np.where(self.v < 0, c.friction - u, 0.0))
        speed = np.abs(self.v)
        with np.errstate(divide="ignore", over="ignore"):
            rate = np.where(braking > 0, speed / np.where(braking > 0, braking, 1.0), np.inf)
            damped = c.delta * rate
            stop = np.where(
                damped > 1e-9,
                np.log1p(damped) / np.where(c.delta > 0, c.delta, 1.0),
                rate,
            )
        stop = np.where(self.v == 0, 0.0, stop)
        until = np.minimum(stop, time)
        self._piece(c.delta, np.where(inward, u + c.friction, u - c.friction), until)
        stopped = stop <= time
        if stopped.any():
            self.v = np.where(stopped, 0.0, self.v)
            rest = np.where(stopped, time - until, 0.0)
            self._piece(c.delta, np.maximum(u - c.friction, 0.0), rest)

    def _piece(self, delta: FloatArray, net: FloatArray, time: FloatArray) -> None:
        """Move under a constant net torque, within which the speed keeps its sign."""
        at = held_response(delta, time)
        x = self.x + at.position_per_speed * self.v - at.position_per_torque * net
        v = at.speed_per_speed * self.v - at.position_per_speed * net
        out = (x < 0) & (v < 0)
        if out.any():
            self.leaving = np.where(out, np.maximum(self.leaving, -v), self.leaving)
            index = np.flatnonzero(out & (self.x >= 0))
            if index.size:
                crossing = _crossing_speed(
                    delta[index], self.x[index], self.v[index], net[index], time[index]
                )
                self.leaving[index] = np.maximum(self.leaving[index], crossing)
        self.x, self.v = x, v


def _crossing_speed(
    delta: FloatArray, x: FloatArray, v: FloatArray, net: FloatArray, time: FloatArray
) -> FloatArray:
    """Return the outward speed at position 0 in a piece from (x, v), x >= 0, that ends outside.

    The device moves outwards all the time. Newton's method starts from the estimate of a constant
    acceleration; halving keeps it within the piece.
    """
    low, high = np.zeros_like(x), time
    pull = net - delta * v
    root = np.sqrt(np.maximum(v * v + 2 * pull * x, 0.0)) - v
    after = np.minimum(np.divide(2 * x, root, out=np.zeros_like(x), where=root > 0), time)
    for _ in range(_HALVINGS):
        there = held_response(delta, after)
        position = x + there.position_per_speed * v - there.position_per_torque * net
        outward = there.position_per_speed * net - there.speed_per_speed * v
        inside = position > 0
        low, high = np.where(inside, after, low), np.where(inside, high, after)
        closer = after + position / np.where(outward > 0, outward, 1.0)
        within = (outward > 0) & (closer >= low) & (closer <= high)
        moved = np.where(within, closer, 0.5 * (low + high)) - after
        after = after + moved
        if np.max(np.abs(moved)) < _ENOUGH:
            break
    there = held_response(delta, after)
    return there.position_per_speed * net - there.speed_per_speed * v
