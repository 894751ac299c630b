"""Simulates many one-axis servos at once under held torques, exactly; the array form of ``body``.

The formulas and the order of their operations are those of ``haptic_wall.hw.plant.body.step``
without an operator, so that each body moves exactly, to the last bit, as it would alone. Where a
velocity reaches zero within a step, only the bodies concerned take the general step; the logarithm
of that instant is taken one by one, because NumPy's may differ from ``math``'s in the last bit.

Bodies with effects that the ideal one lacks move by ``haptic_wall.hw.plant.many_substeps``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_wall.hw.errors import SpecError
from haptic_wall.hw.plant.many_substeps import ManyEffects, ManySubsteps, Turned
from haptic_wall.hw.plant.response import cached_response
from haptic_wall.hw.plant.responses import responses, times_to_rest

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

_CLEARLY = 1e-9
"""A body that keeps more than this fraction of its speed cannot have stopped, whatever the rounding
"""


class Held(NamedTuple):
    """Responses of many bodies over one step; see ``haptic_wall.hw.plant.response.Response``."""

    h1: Floats
    h: Floats
    s: Floats
    duration: Floats
    """Length of the step [s]"""

    def take(self, index: Indices) -> Held:
        """Return the responses of the bodies at ``index``."""
        return Held(*(array[index] for array in self))


class Bodies:
    """Many bodies with viscous and Coulomb friction, moved in place.

    Arrays of one to four thousand bodies are the fastest: they stay in the cache.

    Attributes:
        position: [rad], shape (n,).
        velocity: [rad/s], shape (n,); always the same array.
    """

    __slots__ = (
        "_coulomb",
        "_decay",
        "_direction",
        "_frictional",
        "_inertia",
        "_many",
        "_mask",
        "_moved",
        "_push",
        "_stuck",
        "_work",
        "position",
        "velocity",
    )

    def __init__(
        self,
        inertia: Floats,
        damping: Floats,
        coulomb: Floats,
        position: Floats,
        velocity: Floats,
        effects: ManyEffects | None = None,
    ) -> None:
        """Create bodies, each as ``haptic_wall.hw.plant.body.PlantParameters``; arrays of (n,).

        Args:
            inertia: [kg·m²].
            damping: Viscous friction [N·m·s/rad].
            coulomb: Coulomb friction [N·m].
            position: Position at the start [rad].
            velocity: Velocity at the start [rad/s].
            effects: Further effects of the bodies; None: none.

        Raises:
            ValueError: A value is out of range.
        """
        for name, array, good, wanted in (
            ("inertia", inertia, inertia > 0.0, "above 0"),
            ("damping", damping, damping >= 0.0, "from 0 up"),
            ("coulomb", coulomb, coulomb >= 0.0, "from 0 up"),
        ):
            bad = ~(good & np.isfinite(array))
            if bad.any():
                raise SpecError(f"{name} is {array[bad][0]}", advice=f"give finite values {wanted}")
        self._many = None if effects is None else ManySubsteps(inertia, damping, coulomb, effects)
        self._inertia = inertia
        self._decay = damping / inertia
        self._coulomb = coulomb
        self._frictional = coulomb > 0.0
        self.position = position.copy()
        self.velocity = velocity.copy()
        self._push, self._work, self._moved, self._direction = np.empty((4, inertia.size))
        self._mask, self._stuck = np.empty((2, inertia.size), dtype=np.bool_)

    @property
    def motor_velocity(self) -> Floats:
        """Return the velocity of the motors [rad/s]: the bodies' own."""
        return self.velocity

    @property
    def motor_position(self) -> Floats:
        """Return the position of the motors [rad]: the bodies' own."""
        return self.position

    def held(self, duration: Floats) -> Held:
        """Return the responses over steps of these lengths [s], >= 0, shape (n,)."""
        decay = self._decay
        h1, h, s = np.empty((3, decay.size))
        slow = decay * duration <= 1.0
        if slow.any():
            h[slow], s[slow] = responses(decay[slow], duration[slow])
            h1[slow] = 1.0 - decay[slow] * h[slow]
        for i in np.flatnonzero(~slow).tolist():  # they lose most of their speed within the step
            h1[i], h[i], s[i], _ = cached_response(float(decay[i]), 0.0, float(duration[i]))
        return Held(h1, h, s, duration.copy())

    def step(
        self,
        torque: Floats,
        over: Held,
        out: Floats | None = None,
        outside: Floats | float = 0.0,
    ) -> None:
        """Move all bodies under torques [N·m] held for the step's length.

        Args:
            torque: Torque of the motors, shape (n,).
            over: From ``held``, for this length.
            out: Array for the new positions, which becomes ``position``; None: in place.
            outside: Torque of an operator [N·m].
        """
        out = self.position if out is None else out
        if self._many is not None:
            self._in_substeps(self._many, torque, over, out, outside)
            return
        torque = _sum(torque, outside)
        if self._frictional.any():
            self._slide_or_stick(torque, over, out)
        else:
            self._slide(torque, over, out)
        self.position = out

    def step_turning(
        self,
        torque: Floats,
        over: Held,
        out: Floats | None = None,
        outside: Floats | float = 0.0,
    ) -> list[Turned]:
        """Move as ``step`` does; return where velocities reached zero, in order of time."""
        out = self.position if out is None else out
        if self._many is not None:
            return self._in_substeps(self._many, torque, over, out, outside)
        torque = _sum(torque, outside)
        position, velocity, turned = _through_rest(
            self.position, self.velocity, torque, self._inertia, self._coulomb, self._decay, over
        )
        np.copyto(out, position)
        np.copyto(self.velocity, velocity)
        self.position = out
        return [turned]

    def _in_substeps(
        self,
        many: ManySubsteps,
        torque: Floats,
        over: Held,
        out: Floats,
        outside: Floats | float,
    ) -> list[Turned]:
        np.copyto(out, self.position)
        turned = many.step(out, self.velocity, torque, over.duration, outside)
        self.position = out
        return turned

    def _slide(self, torque: Floats, over: Held, out: Floats) -> None:
        velocity, push, work = self.velocity, self._push, self._work
        np.divide(torque, self._inertia, push)
        np.multiply(velocity, over.h, work)
        np.add(self.position, work, out)
        np.multiply(push, over.s, work)
        np.add(out, work, out)
        np.multiply(velocity, over.h1, velocity)
        np.multiply(push, over.h, push)
        np.add(velocity, push, velocity)

    def _slide_or_stick(self, torque: Floats, over: Held, out: Floats) -> None:
        position, velocity, coulomb = self.position, self.velocity, self._coulomb
        push, work, moved, direction = self._push, self._work, self._moved, self._direction
        kept, stuck = self._mask, self._stuck
        np.copyto(direction, velocity)
        np.equal(velocity, 0.0, stuck)
        np.copyto(direction, torque, where=stuck)
        np.absolute(torque, work)
        np.less_equal(work, coulomb, kept)
        np.logical_and(stuck, kept, stuck)
        np.copysign(coulomb, direction, push)
        np.subtract(torque, push, push)
        np.divide(push, self._inertia, push)
        np.multiply(velocity, over.h, work)
        np.add(position, work, moved)
        np.multiply(push, over.s, work)
        np.add(moved, work, moved)
        np.multiply(velocity, over.h1, work)
        np.multiply(push, over.h, push)
        np.add(work, push, push)  # the velocity at the end if it keeps its sign
        np.multiply(push, direction, work)
        # Without a spring the velocity is monotone: if it keeps its sign it was never zero.
        np.greater(work, 0.0, kept)
        np.logical_or(kept, stuck, kept)
        np.copyto(moved, position, where=stuck)
        np.copyto(push, 0.0, where=stuck)
        if not kept.all():
            few = np.flatnonzero(~kept & self._frictional)
            moved[few], push[few], _ = _through_rest(
                position[few],
                velocity[few],
                torque[few],
                self._inertia[few],
                coulomb[few],
                self._decay[few],
                over.take(few),
            )
        np.copyto(out, moved)
        np.copyto(velocity, push)


def _sum(torque: Floats, outside: Floats | float) -> Floats:
    if isinstance(outside, float) and outside == 0.0:
        return torque
    return torque + outside


def _through_rest(
    position: Floats,
    velocity: Floats,
    torque: Floats,
    inertia: Floats,
    coulomb: Floats,
    decay: Floats,
    over: Held,
) -> tuple[Floats, Floats, Turned]:
    """Take the general step of ``haptic_wall.hw.plant.body``: slide to rest, stay or slide on.

    Returns:
        Position, velocity, and the bodies that came to rest on the way.
    """
    pull = torque / inertia
    friction = coulomb / inertia
    moves = (velocity != 0.0) | (np.abs(pull) > friction)
    direction = np.copysign(1.0, np.where(velocity != 0.0, velocity, pull))
    push = pull - direction * friction
    end = velocity * over.h1 + push * over.h
    distance = velocity * over.h + push * over.s
    after = np.where(moves, position + distance, position)
    # Rounding may put the end on the other side of zero: it is zero.
    speed = np.where(moves & (end * direction > 0.0), end, 0.0)

    may_rest = (velocity != 0.0) & (push != 0.0) & ((velocity > 0.0) != (push > 0.0))
    may_rest &= end * direction <= _CLEARLY * np.abs(velocity)
    index = np.flatnonzero(may_rest)
    if index.size:
        rest = times_to_rest(velocity[index], push[index], decay[index])
        in_time = rest < over.duration[index]
        index, rest = index[in_time], rest[in_time]
    if not index.size:
        return after, speed, Turned(index, np.empty(0))
    decay = decay[index]
    both = responses(
        np.concatenate([decay, decay]), np.concatenate([rest, over.duration[index] - rest])
    )
    (h, h_after), (s, s_after) = both.reshape(2, 2, index.size)
    turn = position[index] + (velocity[index] * h + push[index] * s)
    pull, friction = pull[index], friction[index]
    direction = np.copysign(1.0, pull)
    push = pull - direction * friction
    leaves = np.abs(pull) > friction
    end = push * h_after
    after[index] = np.where(leaves, turn + push * s_after, turn)
    speed[index] = np.where(leaves & (end * direction > 0.0), end, 0.0)
    return after, speed, Turned(index, turn)
