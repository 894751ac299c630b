"""Moves a servo with the effects of ``haptic_wall.hw.plant.effects``, in substeps.

The linear part of the motion (held torque, viscous friction, the operator's spring) is exact, as in
``haptic_wall.hw.plant.body``. The other torques are held over a substep, at the values that they
have in its middle: the error falls with the square of the substep's length. For torques of the
position alone this is the Störmer-Verlet method, which neither feeds nor drains an oscillation.
The instants of rest and of breaking away are solved for. A body at rest is exactly at rest.
"""

from __future__ import annotations

import math

from haptic_wall.hw.plant.body import PlantParameters, Pull, State
from haptic_wall.hw.plant.effects import Effects
from haptic_wall.hw.plant.response import Slide, cached_response, response, time_to_rest

GRAIN_S = 2.5e-4
"""Longest substep [s]"""
PHASE = 0.02
"""Longest substep, in radians of the fastest oscillation that weight and cogging can make"""
TEETH = 0.3
"""Largest change of the cogging's phase within a substep [rad]"""
FALL = 0.1
"""Largest change of speed within a substep, in Stribeck speeds, while the friction depends on it"""
FADED = 12.0
"""Speed from which on nothing is left of the excess friction, in Stribeck speeds"""
SHORTEST_S = 1e-7
"""Substeps do not get shorter than this [s]; events do"""
_ONE_TURN = 9.0
"""Square of a phase below pi: two zeros of an oscillator's acceleration are at least pi apart"""


def grain_of(inertia: float, effects: Effects, *, fading: bool) -> float:
    """Return the longest substep of a servo [s]; infinite where every step is exact.

    Args:
        inertia: [kg·m²].
        effects: Its effects.
        fading: The friction depends on the speed.
    """
    stiffness = effects.gravity + effects.cogging * effects.cogging_periods
    if stiffness > 0.0:
        return max(min(GRAIN_S, PHASE * math.sqrt(inertia / stiffness)), SHORTEST_S)
    return GRAIN_S if fading or effects.load_friction > 0.0 else math.inf


class Substeps:
    """Moves one body with these effects."""

    __slots__ = (
        "_angle",
        "_back",
        "_cogging",
        "_coulomb",
        "_excess",
        "_fading",
        "_fall",
        "_forth",
        "_grain",
        "_gravity",
        "_inertia",
        "_load",
        "_periods",
        "_phase",
        "_static",
        "_stribeck",
        "_teeth",
    )

    def __init__(
        self, parameters: PlantParameters, effects: Effects, *, fineness: float = 1.0
    ) -> None:
        """Prepare for a body.

        Args:
            parameters: Inertia, viscous and Coulomb friction.
            effects: The other effects.
            fineness: Every substep is shortened by this factor, to see how the error falls.

        Raises:
            ValueError: The static friction lies below the Coulomb friction.
        """
        self._inertia = parameters.inertia
        self._forth = parameters.damping
        back = effects.damping_back
        self._back = parameters.damping if back is None else back
        self._coulomb = parameters.coulomb
        self._static = effects.breakaway(parameters.coulomb)
        self._excess = self._static - self._coulomb
        self._stribeck = effects.stribeck_speed
        self._fading = self._excess > 0.0 and self._stribeck > 0.0
        self._load = effects.load_friction
        self._gravity, self._angle = effects.gravity, effects.gravity_angle
        self._cogging, self._periods = effects.cogging, effects.cogging_periods
        self._phase = effects.cogging_phase
        self._grain = grain_of(parameters.inertia, effects, fading=self._fading) / fineness
        self._teeth, self._fall = TEETH / fineness, FALL / fineness

    def step(
        self,
        state: State,
        parameters: PlantParameters,
        torque: float,
        duration: float,
        pull: Pull | None = None,
        *,
        turns: list[float] | None = None,
    ) -> State:
        """Return the state after ``duration`` [s] under a held torque.

        Args:
            state: Position [rad] and velocity [rad/s] at the start.
            parameters: As given at the start, but for more damping: that is the fall of the motor's
                torque with the velocity.
            torque: Of the motor at rest, held over the whole step [N·m].
            duration: Length of the step [s], >= 0.
            pull: The operator; None: no operator.
            turns: If given, the positions [rad] at which the velocity reached zero are appended.
        """
        position, velocity = state
        braking = parameters.damping - self._forth
        hand = _NOBODY if pull is None else pull
        left = duration
        grain = duration / max(1, math.ceil(duration / self._grain - 1e-9))
        while left > 0.0:
            if velocity != 0.0:
                direction = math.copysign(1.0, velocity)
            else:
                direction, wait = self._leaves(position, torque, hand, left)
                if direction == 0.0:
                    break
                if wait > 0.0:
                    left -= wait
                    hand = _later(hand, wait)
            most = min(left, grain)
            slide, length = self._slide(position, velocity, direction, torque, braking, hand, most)
            distance, velocity, took = _slid(slide, length, direction, repeats=length == grain)
            position += distance
            left = left - took if left > took * (1.0 + 1e-9) else 0.0
            if hand.slope != 0.0:
                hand = _later(hand, took)
            if took < length and turns is not None:
                turns.append(position)
        return State(position, velocity)

    def _leaves(
        self, position: float, torque: float, hand: Pull, left: float
    ) -> tuple[float, float]:
        """Return in which direction a body at rest breaks away, and when [s]; 0: it stays."""
        stiffness, grip, reference, slope = hand
        weight = -self._gravity * math.sin(position - self._angle)
        outside = stiffness * (reference - position) + grip * slope + weight
        push = torque + outside + self._cogs(position)
        if abs(push) > self._static + self._load * abs(torque - outside):
            return math.copysign(1.0, push), 0.0
        ramp = stiffness * slope
        if ramp == 0.0:
            return 0.0, 0.0
        direction = math.copysign(1.0, ramp)
        grown = self._until_breakaway(direction * push, direction * (torque - outside))
        wait = grown / abs(ramp)
        return (direction, wait) if wait < left else (0.0, 0.0)

    def _slide(
        self,
        position: float,
        velocity: float,
        direction: float,
        torque: float,
        braking: float,
        hand: Pull,
        most: float,
    ) -> tuple[Slide, float]:
        """Return the motion with held torques, and for how long that may be taken [s]."""
        stiffness, grip, reference, slope = hand
        inertia, load = self._inertia, self._load
        viscous = (self._forth if direction > 0.0 else self._back) + braking
        pulled = stiffness * (reference - position) + grip * slope
        speed = abs(velocity)
        weight = -self._gravity * math.sin(position - self._angle)
        friction = self._in_motion(speed)
        if load > 0.0:
            friction += load * abs(torque - braking * velocity - pulled + grip * velocity - weight)
        push = torque + pulled + weight + self._cogs(position) - direction * friction
        gain = (push - (viscous + grip) * velocity) / inertia
        length = min(most, self._length(most, speed, gain))

        half = 0.5 * length
        middle = position + half * velocity
        pace = velocity + half * gain
        if pace * direction < 0.0:
            pace = 0.0
        weight = -self._gravity * math.sin(middle - self._angle)
        friction = self._in_motion(abs(pace))
        if load > 0.0:
            held = stiffness * (reference + slope * half - middle) + grip * (slope - pace)
            friction += load * abs(torque - braking * pace - held - weight)
        push = torque + pulled + weight + self._cogs(middle) - direction * friction
        if velocity == 0.0 and direction * push < 0.0:
            push = 0.0  # it breaks away just now: what holds it grows faster than what pushes
        slide = Slide(
            velocity,
            push / inertia,
            stiffness * slope / inertia,
            (viscous + grip) / inertia,
            stiffness / inertia,
        )
        return slide, length

    def _cogs(self, position: float) -> float:
        if self._cogging == 0.0:
            return 0.0
        return -self._cogging * math.sin(self._periods * position + self._phase)

    def _in_motion(self, speed: float) -> float:
        """Return the friction without load at this speed [N·m]."""
        if not self._fading or speed > FADED * self._stribeck:
            return self._coulomb
        return self._coulomb + self._excess * math.exp(-speed / self._stribeck)

    def _length(self, grain: float, speed: float, gain: float) -> float:
        """Return the longest substep at this speed [rad/s] and acceleration [rad/s²]."""
        if self._cogging > 0.0 and self._periods * speed * grain > self._teeth:
            grain = max(self._teeth / (self._periods * speed), SHORTEST_S)
        if not self._fading:
            return grain
        # The error of a substep goes with the square of the change and with what is left of the
        # excess: the further it has faded, the longer the substep. Twice: the speed changes in it.
        scale = self._stribeck
        rate = abs(gain)
        length, slower = grain, speed
        for _ in range(2):
            if slower > FADED * scale:
                return length
            left = math.exp(-0.5 * slower / scale)
            steepest = self._excess / self._inertia * left * left
            length = min(grain, self._fall * scale / (left * (rate + steepest)))
            slower = max(speed - rate * length, 0.0)
        return max(length, SHORTEST_S)

    def _until_breakaway(self, push: float, across: float) -> float:
        """Return by how much the operator's torque must grow until a stuck body breaks away [N·m].

        Args:
            push: Torque on the body, in the direction of the growth [N·m].
            across: Motor's torque less the external one, in that direction [N·m].
        """
        load = self._load
        grown = (self._static - push + load * across) / (1.0 + load)
        if grown > across:  # the external torque has passed the motor's
            grown = (self._static - push - load * across) / (1.0 - load)
        return max(grown, 0.0)


_NOBODY = Pull(0.0, 0.0, 0.0, 0.0)


def _later(hand: Pull, time: float) -> Pull:
    """Return the operator's pull ``time`` [s] later."""
    return hand._replace(reference=hand.reference + hand.slope * time)


def _slid(
    slide: Slide, length: float, direction: float, *, repeats: bool
) -> tuple[float, float, float]:
    """Return distance [rad], velocity [rad/s] and time [s] of a slide, up to rest at most."""
    velocity, push, ramp, decay, spring = slide
    if velocity == 0.0 and push == 0.0 and direction * ramp <= 0.0:
        return 0.0, 0.0, length
    over = (cached_response if repeats else response)(decay, spring, length)
    distance, end = slide.moved(over)
    if direction * end > 0.0:
        if spring == 0.0:  # the velocity is monotone
            return distance, end, length
        if spring * length * length < _ONE_TURN:
            # The acceleration is zero at most once: the speed fell and grew again, or it did not.
            fell = (push - decay * velocity) * direction < 0.0
            left = push + ramp * length - spring * distance - decay * end
            if not fell or left * direction <= 0.0:
                return distance, end, length
    rest = time_to_rest(slide, length)
    if rest is None:
        # Rounding may put the end on the other side of zero: it is zero.
        return distance, end if direction * end > 0.0 else 0.0, length
    return slide.moved(response(decay, spring, rest))[0], 0.0, rest
