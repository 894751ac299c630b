"""Simulates contacts with a sampled one-sided wall, and returns the device's exit speed.

Many contacts are simulated at once, dimensionless (period 1, inertia 1, entry speed 1). The motion
between two switches of the torque is computed exactly. The wall fills the positions above 0. A
sample inside gives the torque ``max(0, alpha x + beta v)`` outwards, a sample outside gives 0. Here
v is the velocity difference over N positions, including those before the contact. Before the
contact the device moves freely.

The wall's law is homogeneous of degree 1, so the ratio of exit to entry speed does not depend on
the entry speed. It depends on the phase: the time from the entry to the first sample inside.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.controller.theory.response import HeldResponse, held_response

_SWEEP = 8  # periods between two checks for contacts that are over
_HALVINGS, _ENOUGH = 60, 1e-7  # steps at most, and the last one [periods]


@dataclass(frozen=True, slots=True)
class Contacts:
    """Contacts to simulate; flat arrays of one length."""

    delta: FloatArray
    """Viscous damping b T / m"""
    alpha: FloatArray
    """Stiffness K T² / m"""
    beta: FloatArray
    """Virtual damping B T / m"""
    delay: FloatArray
    """Total delay in periods"""
    samples: IntArray
    """N of the velocity difference"""
    phase: FloatArray
    """From the entry to the first sample inside [periods], 0 to 1; at 0 it counts as inside"""

    def take(self, index: NDArray[np.bool_] | IntArray) -> Contacts:
        """Return the contacts at ``index``."""
        return Contacts(*(getattr(self, field.name)[index] for field in fields(self)))


def exit_speed(contacts: Contacts, floor: float) -> FloatArray:
    """Return the ratio of exit speed to entry speed of each contact.

    The exit speed is the greatest speed outside the wall until the last commanded torque has ended:
    a delayed torque that acts after the device has left counts too.

    Args:
        contacts: Contacts to simulate.
        floor: Smallest ratio of interest. The simulation of a contact ends when its exit speed can
            no longer exceed the floor, because an overdamped contact creeps out for ever. Its
            result is then a bound between the true value and the floor.
    """
    result = np.empty_like(contacts.delta)
    place = np.arange(result.size)
    c = contacts
    whole = np.floor(c.delay).astype(np.int64)
    # Over a whole step, over the part before the step's sample, and back to the step's beginning.
    full, partial, backward = (
        held_response(c.delta, t) for t in (1.0, _until_sample(c.delay), -1.0)
    )
    # A step runs from one switch of the torque to the next; sample k falls into step k, at
    # 1 - f from its start. The torque of sample k acts during step k + 1 + whole.
    start = held_response(c.delta, c.phase - _until_sample(c.delay))
    x, v = start.position_per_speed, start.speed_per_speed
    commands = np.zeros((int(whole.max(initial=0)) + 2, result.size))
    positions = np.zeros((int(c.samples.max(initial=1)) + 1, result.size))
    for back in range(1, positions.shape[0]):
        positions[-back] = held_response(c.delta, c.phase - back).position_per_speed
    leaving = np.zeros_like(x)
    pending = np.zeros_like(x)  # commanded impulse that has not acted yet
    gone = np.zeros(result.size, dtype=np.int64)  # samples since the first one outside
    columns = np.arange(result.size)
    k = 0
    while place.size:
        u = commands[(k - 1 - whole) % commands.shape[0], columns]
        measured = x + partial.position_per_speed * v - partial.position_per_torque * u
        before = positions[(k - c.samples) % positions.shape[0], columns]
        inside = measured > 0 if k else np.ones_like(gone, dtype=np.bool_)
        command = np.maximum(c.alpha * measured + c.beta * (measured - before) / c.samples, 0.0)
        command *= inside
        positions[k % positions.shape[0]] = measured
        commands[k % commands.shape[0]] = command
        x = x + full.position_per_speed * v - full.position_per_torque * u
        v = full.speed_per_speed * v - full.position_per_speed * u
        out = (x <= 0) & (v < 0)
        if out.any():
            outward = _outward(c.delta, backward, x, v, u, leaving)
            leaving = np.where(out, np.maximum(leaving, outward), 0.0)
        pending += command - u
        gone += (gone > 0) | ~inside
        k += 1
        if k % _SWEEP:
            continue
        bound = np.sqrt(v * v + c.alpha * x * x) + pending
        over = (gone > whole) | (bound < floor)
        if not over.any():
            continue
        result[place[over]] = np.where(gone > whole, leaving, np.maximum(leaving, bound))[over]
        on = ~over
        c, place, whole, x, v = c.take(on), place[on], whole[on], x[on], v[on]
        leaving, pending, gone = leaving[on], pending[on], gone[on]
        commands, positions = commands[:, on], positions[:, on]
        columns = np.arange(place.size)
        full, partial, backward = (_at(response, on) for response in (full, partial, backward))
    return np.maximum(result, 0.0)


def _outward(
    delta: FloatArray,
    backward: HeldResponse,
    x: FloatArray,
    v: FloatArray,
    u: FloatArray,
    before: FloatArray,
) -> FloatArray:
    """Return the greatest outward speed outside the wall, in a step that ends outside at (x, v).

    Under a held torque the speed changes monotonically. It is greatest at the step's end or where
    the device crossed the wall.
    """
    fastest: FloatArray = -v
    index = np.flatnonzero((before == 0) & (x <= 0) & (v < 0))
    if index.size:
        there = _speed_at_wall(delta[index], _at(backward, index), x[index], v[index], u[index])
        fastest[index] = np.maximum(fastest[index], there)
    return fastest


def _speed_at_wall(
    delta: FloatArray, began: HeldResponse, x: FloatArray, v: FloatArray, u: FloatArray
) -> FloatArray:
    """Return the outward speed at position 0 in the step that led to (x, v), x <= 0, v < 0.

    The torque u is held during the step. Newton's method goes backwards in time from the estimate
    of a constant acceleration; halving keeps it within the step.

    Returns:
        The speed; 0 where the step began outside.
    """
    result = np.zeros_like(x)
    place = np.flatnonzero(x + began.position_per_speed * v >= began.position_per_torque * u)
    delta, x, v, u = delta[place], x[place], v[place], u[place]
    low, high = np.zeros_like(x), np.ones_like(x)
    pull = -u - delta * v
    ago = np.minimum(2 * x / (v - np.sqrt(np.maximum(v * v - 2 * pull * x, 0.0))), 1.0)
    for _ in range(_HALVINGS):
        back = held_response(delta, -ago)
        position = x + back.position_per_speed * v - back.position_per_torque * u
        speed = back.speed_per_speed * v - back.position_per_speed * u
        low, high = np.where(position < 0, ago, low), np.where(position < 0, high, ago)
        outward = speed < 0  # else the device had not turned yet
        closer = ago + position / np.where(outward, speed, 1.0)
        inside = outward & (closer >= low) & (closer <= high)
        moved = np.where(inside, closer, 0.5 * (low + high)) - ago
        ago = ago + moved
        if np.max(np.abs(moved), initial=0.0) < _ENOUGH:
            break
    result[place] = -(v + delta * x + u * ago)  # momentum balance since that instant
    return result


def _until_sample(delay: FloatArray) -> FloatArray:
    """Return the time from a switch of the torque to the next sample [periods]: 1 - frac(delay)."""
    return 1.0 - (delay - np.floor(delay))


def _at(response: HeldResponse, index: NDArray[np.bool_] | IntArray) -> HeldResponse:
    """Return the response of the contacts at ``index``."""
    return HeldResponse(*(part[index] for part in response))
