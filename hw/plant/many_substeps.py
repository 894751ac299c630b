"""Simulates many bodies with effects at once; the array form of ``haptic_wall.hw.plant.substeps``.

The formulas are those of ``Substeps`` without an operator model. Each body has substeps of its own.
A body moves as in ``Substeps`` up to rounding, because NumPy's functions may differ from ``math``'s
in the last bit. Rounding matters where a body only just stops or breaks away.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_wall.hw.plant.effects import Effects
from haptic_wall.hw.plant.responses import responses, times_to_rest
from haptic_wall.hw.plant.substeps import FADED, GRAIN_S, PHASE, SHORTEST_S, TEETH, fall_of

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]


class Turned(NamedTuple):
    """Bodies that came to rest within a step; each body at most once."""

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
    stribeck_exponent: Floats
    load_friction_external: Floats
    load_friction_at_rest: Floats
    load_friction_at_rest_external: Floats
    load_friction_square: Floats
    """[1/(N·m)]"""
    load_friction_square_external: Floats
    """[1/(N·m)]"""
    torque_ripple: Floats
    torque_ripple_periods: Floats
    torque_ripple_phase: Floats
    """[rad]"""

    @classmethod
    def alike(cls, effects: Effects, damping: float, coulomb: float, count: int) -> ManyEffects:
        """Return the effects of ``count`` equal servos with viscous and Coulomb friction."""
        back = damping if effects.damping_back is None else effects.damping_back
        values = {field.name: getattr(effects, field.name) for field in fields(cls)}
        values |= {"static_friction": effects.breakaway(coulomb), "damping_back": back}
        values["load_friction_external"] = effects.load.external
        values["load_friction_at_rest_external"] = effects.load.rest_external
        return cls(**{name: np.full(count, value) for name, value in values.items()})

    @classmethod
    def none(cls, damping: Floats, coulomb: Floats, **effects: Floats) -> ManyEffects:
        """Return only the named effects, for servos with this friction; arrays of (n,)."""
        found = cls.alike(Effects(), 0.0, 0.0, damping.size)
        values = {"static_friction": coulomb, "damping_back": damping, **effects}
        for part in ("load_friction", "load_friction_at_rest"):
            if part in values:
                values.setdefault(f"{part}_external", values[part])
        return replace(found, **values)

    def take(self, index: Indices | slice) -> ManyEffects:
        """Return the effects of the servos at ``index``."""
        return ManyEffects(*(getattr(self, field.name)[index] for field in fields(self)))


class ManySubsteps:
    """Moves many bodies with effects, substep by substep."""

    __slots__ = (
        "_coulomb",
        "_effects",
        "_faded",
        "_fall",
        "_forth",
        "_grain",
        "_inertia",
        "_loaded",
        "_rests",
        "_rippled",
        "_stiffness",
    )

    def __init__(
        self, inertia: Floats, damping: Floats, coulomb: Floats, effects: ManyEffects
    ) -> None:
        """Prepare the bodies; arrays of (n,).

        Raises:
            ValueError: A static friction lies below the Coulomb friction.
        """
        if (effects.static_friction < coulomb).any():
            raise ValueError("a static_friction lies below coulomb; give at least as much")
        self._inertia, self._forth, self._coulomb = inertia, damping, coulomb
        self._effects = effects
        at_rest = effects.load_friction_at_rest + effects.load_friction_at_rest_external
        at_rest += effects.load_friction_square + effects.load_friction_square_external
        load = effects.load_friction + effects.load_friction_external + at_rest
        self._loaded, self._rests = bool((load > 0.0).any()), bool((at_rest > 0.0).any())
        self._rippled = bool((effects.torque_ripple > 0.0).any())
        excess = (effects.static_friction > coulomb) | (at_rest > 0.0)
        fading = (effects.stribeck_speed > 0.0) & excess
        exact = ~fading & (load == 0.0) & (effects.torque_ripple == 0.0)
        self._grain = np.where(exact, np.inf, GRAIN_S)
        self._stiffness = effects.gravity + effects.cogging * effects.cogging_periods
        self._faded = effects.stribeck_speed * FADED ** (1.0 / effects.stribeck_exponent)
        falls = [fall_of(exponent) for exponent in effects.stribeck_exponent.tolist()]
        self._fall = np.array(falls) * effects.stribeck_speed

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
            torque: Torque of the motors, held [N·m], shape (n,).
            duration: Length of the step [s], shape (n,).
            outside: Torque from outside, held [N·m].

        Returns:
            The bodies that came to rest within the step, in order of time; each body at most once
            in an entry.
        """
        left = duration.copy()
        grain = duration / np.maximum(1.0, np.ceil(duration / self._longest(torque) - 1e-9))
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

    def _longest(self, torque: Floats) -> Floats:
        """Return the longest substep of each body [s] at this motor torque [N·m]."""
        stiffness, effects = self._stiffness, self._effects
        if self._rippled:
            ripple = effects.torque_ripple * effects.torque_ripple_periods
            stiffness = stiffness + ripple * np.abs(torque)
        stiff = stiffness > 0.0
        if not stiff.any():
            return self._grain
        grain = self._grain.copy()
        finest = PHASE * np.sqrt(self._inertia[stiff] / stiffness[stiff])
        grain[stiff] = np.maximum(np.minimum(GRAIN_S, finest), SHORTEST_S)
        return grain


class _Some:
    """Computes one substep of some of the bodies."""

    def __init__(self, many: ManySubsteps, index: Indices, torque: Floats, outside: Floats) -> None:
        self.inertia, self.forth = many._inertia[index], many._forth[index]
        self.coulomb, self.effects = many._coulomb[index], many._effects.take(index)
        self.faded, self.fall = many._faded[index], many._fall[index]
        self.excess = self.effects.static_friction - self.coulomb
        self.loaded, self.rests, self.rippled = many._loaded, many._rests, many._rippled
        self.torque, self.outside = torque, outside

    def moved(
        self, position: Floats, velocity: Floats, most: Floats
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Return distance [rad], end velocity [rad/s], time moved and substep [s]; 0 if stuck."""
        effects, inertia = self.effects, self.inertia
        push, steady, excess = self._torques(position)
        at_rest = velocity == 0.0
        stuck = at_rest & (np.abs(push) <= steady + excess)
        direction = np.copysign(1.0, np.where(at_rest, push, velocity))
        viscous = np.where(direction > 0.0, self.forth, effects.damping_back)
        speed = np.abs(velocity)
        friction = self._in_motion(speed, steady, excess)
        gain = (push - direction * friction - viscous * velocity) / inertia
        length = np.minimum(most, self._length(most, speed, gain, excess))

        middle = position + 0.5 * length * velocity
        pace = velocity + 0.5 * length * gain
        pace[pace * direction < 0.0] = 0.0
        push, steady, excess = self._torques(middle)
        push -= direction * self._in_motion(np.abs(pace), steady, excess)
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

    def _torques(self, position: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the driving torque, the friction in motion, and its increase at rest [N·m]."""
        motor, outside = self.torque, self.outside + self._weight(position)
        if self.rippled:
            effects = self.effects
            phase = effects.torque_ripple_periods * position + effects.torque_ripple_phase
            motor = motor * (1.0 + effects.torque_ripple * np.sin(phase))
        push = motor + outside + self._cogs(position)
        if not self.loaded:
            return push, self.coulomb, self.excess
        in_motion, at_rest = self._loads(motor, outside)
        return push, self.coulomb + in_motion, self.excess + at_rest

    def _loads(self, motor: Floats, external: Floats) -> tuple[Floats, Floats | float]:
        """Return the gear's load friction in motion, and its increase at rest [N·m]."""
        e = self.effects
        in_motion = np.abs(e.load_friction * motor - e.load_friction_external * external)
        if not self.rests:
            return in_motion, 0.0
        own, other = e.load_friction_at_rest, e.load_friction_at_rest_external
        at_rest = np.abs(own * motor - other * external)
        across, sizes = motor * external < 0.0, np.abs(motor) - np.abs(external)
        driven = across & (sizes > 0.0)
        at_rest += np.where(driven, e.load_friction_square_external * external**2, 0.0)
        driven = across & (sizes < 0.0)
        at_rest += np.where(driven, e.load_friction_square * motor**2, 0.0)
        return in_motion, at_rest

    def _in_motion(self, speed: Floats, steady: Floats, excess: Floats) -> Floats:
        """Return the friction at these speeds [N·m]."""
        friction = steady.copy()
        near = (self.fall > 0.0) & (speed <= self.faded)
        friction[near] += excess[near] * self._left(speed, near)
        return friction

    def _left(self, speed: Floats, near: Bools) -> Floats:
        """Return the Stribeck factor at these speeds, for the bodies selected by ``near``."""
        effects = self.effects
        relative = speed[near] / effects.stribeck_speed[near]
        result: Floats = np.exp(-(relative ** effects.stribeck_exponent[near]))
        return result

    def _length(self, grain: Floats, speed: Floats, gain: Floats, excess: Floats) -> Floats:
        """Return the longest substep of each body at this speed and acceleration [s]."""
        effects = self.effects
        for size, periods in (
            (effects.cogging, effects.cogging_periods),
            (effects.torque_ripple, effects.torque_ripple_periods),
        ):
            pace = periods * speed
            quick = (size > 0.0) & (pace * grain > TEETH)
            if quick.any():
                grain = grain.copy()
                grain[quick] = np.maximum(TEETH / pace[quick], SHORTEST_S)
        fading = (self.fall > 0.0) & (excess > 0.0)
        if not fading.any():
            return grain
        length, slower, rate, held = grain.copy(), speed, np.abs(gain), ~fading
        steep = excess / self.inertia
        for _ in range(2):
            fading &= slower <= self.faded
            left = np.sqrt(self._left(slower, fading))
            shorter = self.fall[fading] / (left * (rate[fading] + steep[fading] * left * left))
            length[fading] = np.minimum(grain[fading], shorter)
            slower = np.maximum(speed - rate * length, 0.0)
        return np.where(held, grain, np.maximum(length, SHORTEST_S))
