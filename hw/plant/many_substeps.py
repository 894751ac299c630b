"""Moves many servos with effects at once; the array form of ``haptic_wall.hw.plant.substeps``.

The formulas are those of ``Substeps`` without an operator, and each servo takes its own substeps.
NumPy's functions may differ from ``math``'s in the last bit: a servo moves as it would alone up to
rounding, which a motion that hardly stops or hardly breaks away can enlarge.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_wall.hw.plant.effects import Effects
from haptic_wall.hw.plant.responses import responses, times_to_rest
from haptic_wall.hw.plant.substeps import FADED, FALL, GRAIN_S, PHASE, SHORTEST_S, TEETH

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]


class Turned(NamedTuple):
    """Bodies whose velocity reached zero within a step, at most once each."""

    bodies: Indices
    position: Floats
    """Position at that instant [rad]"""


@dataclass(frozen=True, slots=True)
class ManyEffects:
    """Effects of many servos, arrays of one length; see ``haptic_wall.hw.plant.effects``."""

    static_friction: Floats
    """[N·m], at least the Coulomb friction"""
    stribeck_speed: Floats
    """[rad/s]"""
    damping_back: Floats
    """[N·m·s/rad]"""
    load_friction: Floats
    gravity: Floats
    """[N·m]"""
    gravity_angle: Floats
    """[rad]"""
    cogging: Floats
    """[N·m]"""
    cogging_periods: Floats
    cogging_phase: Floats
    """[rad]"""

    @classmethod
    def alike(cls, effects: Effects, damping: float, coulomb: float, count: int) -> ManyEffects:
        """Return the effects of ``count`` equal servos with this friction [N·m·s/rad, N·m]."""
        back = damping if effects.damping_back is None else effects.damping_back
        values = {field.name: getattr(effects, field.name) for field in fields(cls)}
        values |= {"static_friction": effects.breakaway(coulomb), "damping_back": back}
        return cls(**{name: np.full(count, value) for name, value in values.items()})

    def take(self, index: Indices | slice) -> ManyEffects:
        """Return the effects of the servos at ``index``."""
        return ManyEffects(*(getattr(self, field.name)[index] for field in fields(self)))


class ManySubsteps:
    """Moves many bodies with effects."""

    __slots__ = ("_coulomb", "_effects", "_forth", "_grain", "_inertia")

    def __init__(
        self, inertia: Floats, damping: Floats, coulomb: Floats, effects: ManyEffects
    ) -> None:
        """Prepare for these bodies, arrays of (n,).

        Raises:
            ValueError: A static friction lies below the Coulomb friction.
        """
        if (effects.static_friction < coulomb).any():
            raise ValueError("a static_friction lies below coulomb; give at least as much")
        self._inertia, self._forth, self._coulomb = inertia, damping, coulomb
        self._effects = effects
        stiffness = effects.gravity + effects.cogging * effects.cogging_periods
        fading = (effects.stribeck_speed > 0.0) & (effects.static_friction > coulomb)
        exact = ~fading & (effects.load_friction == 0.0)
        grain = np.where(exact, np.inf, GRAIN_S)
        stiff = stiffness > 0.0
        finest = PHASE * np.sqrt(inertia[stiff] / stiffness[stiff])
        grain[stiff] = np.maximum(np.minimum(GRAIN_S, finest), SHORTEST_S)
        self._grain = grain

    def step(
        self,
        position: Floats,
        velocity: Floats,
        torque: Floats,
        duration: Floats,
        outside: Floats | float = 0.0,
    ) -> list[Turned]:
        """Move all bodies, in place.

        Args:
            position: [rad], shape (n,).
            velocity: [rad/s], shape (n,).
            torque: Of the motors, held [N·m], shape (n,).
            duration: Length of the step [s], shape (n,).
            outside: Torque from outside, held [N·m].

        Returns:
            The bodies that came to rest on the way, each at most once an entry, in order of time.
        """
        left = duration.copy()
        grain = duration / np.maximum(1.0, np.ceil(duration / self._grain - 1e-9))
        outside = np.broadcast_to(outside, position.shape)
        index = np.flatnonzero(left > 0.0)
        turned = []
        while index.size:
            some = _Some(self, index, torque[index], outside[index])
            x, v = position[index], velocity[index]
            most = np.minimum(left[index], grain[index])
            distance, end, took, length = some.moved(x, v, most)
            position[index] = x + distance
            velocity[index] = end
            rests = took < length
            if rests.any():
                turned.append(Turned(index[rests], position[index[rests]]))
            before = left[index]
            after = np.where(before > took * (1.0 + 1e-9), before - took, 0.0)
            after[length == 0.0] = 0.0
            left[index] = after
            index = index[after > 0.0]
        return turned


class _Some:
    """Some of the bodies, during one substep."""

    def __init__(self, many: ManySubsteps, index: Indices, torque: Floats, outside: Floats) -> None:
        self.inertia, self.forth = many._inertia[index], many._forth[index]
        self.coulomb, self.effects = many._coulomb[index], many._effects.take(index)
        self.torque, self.outside = torque, outside

    def moved(
        self, position: Floats, velocity: Floats, most: Floats
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Return distances [rad], velocities [rad/s], times taken and meant [s]; 0, 0: it stays."""
        effects, inertia = self.effects, self.inertia
        outside = self.outside + self._weight(position)
        cogs = self._cogs(position)
        push = self.torque + outside + cogs
        load = effects.load_friction * np.abs(self.torque - outside)
        at_rest = velocity == 0.0
        stuck = at_rest & (np.abs(push) <= effects.static_friction + load)
        direction = np.copysign(1.0, np.where(at_rest, push, velocity))
        viscous = np.where(direction > 0.0, self.forth, effects.damping_back)
        speed = np.abs(velocity)
        friction = self._in_motion(speed) + load
        gain = (push - direction * friction - viscous * velocity) / inertia
        length = np.minimum(most, self._length(most, speed, gain))

        middle = position + 0.5 * length * velocity
        pace = velocity + 0.5 * length * gain
        pace[pace * direction < 0.0] = 0.0
        outside = self.outside + self._weight(middle)
        friction = self._in_motion(np.abs(pace))
        friction += effects.load_friction * np.abs(self.torque - outside)
        push = self.torque + outside + self._cogs(middle) - direction * friction
        push[at_rest & (direction * push < 0.0)] = 0.0
        push /= inertia
        decay = viscous / inertia
        h, s = responses(decay, length)
        distance = velocity * h + push * s
        end = velocity * (1.0 - decay * h) + push * h
        took = length.copy()
        kept = direction * end > 0.0
        end[~kept] = 0.0
        slower = ~kept & ~at_rest & (direction * push < 0.0)
        few = np.flatnonzero(slower)
        if few.size:
            rest = times_to_rest(velocity[few], push[few], decay[few])
            in_time = rest < length[few]
            few, rest = few[in_time], rest[in_time]
        if few.size:
            h, s = responses(decay[few], rest)
            distance[few] = velocity[few] * h + push[few] * s
            took[few] = rest
        for array in (distance, end, took, length):
            array[stuck] = 0.0
        return distance, end, took, length

    def _weight(self, position: Floats) -> Floats:
        effects = self.effects
        result: Floats = -effects.gravity * np.sin(position - effects.gravity_angle)
        return result

    def _cogs(self, position: Floats) -> Floats:
        effects = self.effects
        phase = effects.cogging_periods * position + effects.cogging_phase
        result: Floats = -effects.cogging * np.sin(phase)
        return result

    def _in_motion(self, speed: Floats) -> Floats:
        """Return the friction without load at these speeds [N·m]."""
        scale = self.effects.stribeck_speed
        friction = self.coulomb.copy()
        near = (scale > 0.0) & (speed <= FADED * scale)
        excess = (self.effects.static_friction - self.coulomb)[near]
        friction[near] += excess * np.exp(-speed[near] / scale[near])
        return friction

    def _length(self, grain: Floats, speed: Floats, gain: Floats) -> Floats:
        """Return the longest substeps [s]."""
        effects = self.effects
        pace = effects.cogging_periods * speed
        quick = (effects.cogging > 0.0) & (pace * grain > TEETH)
        if quick.any():
            grain = grain.copy()
            grain[quick] = np.maximum(TEETH / pace[quick], SHORTEST_S)
        scale = effects.stribeck_speed
        excess = (effects.static_friction - self.coulomb) / self.inertia
        fading = (scale > 0.0) & (excess > 0.0)
        if not fading.any():
            return grain
        length, slower, rate = grain.copy(), speed, np.abs(gain)
        scale = np.where(fading, scale, 1.0)
        for _ in range(2):
            fading &= slower <= FADED * scale
            left = np.exp(-0.5 * slower / scale)
            shorter = np.minimum(grain, FALL * scale / (left * (rate + excess * left * left)))
            length = np.where(fading, shorter, length)
            slower = np.maximum(speed - rate * length, 0.0)
        return np.where(scale > 0.0, np.maximum(length, SHORTEST_S), length)
