"""Simulates a servo with the effects of ``haptic_wall.hw.plant.effects``, in substeps.

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
"""Longest substep, in radians of the fastest oscillation that position-dependent torques make"""
TEETH = 0.3
"""Largest change of the phase of cogging and ripple within a substep [rad]"""
FALL = 0.1
"""Largest change of speed within a substep, in Stribeck speeds, while the friction depends on it"""
FADED = 12.0
"""Power of the relative speed from which on nothing is left of the excess friction"""
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
        return finest(inertia, stiffness)
    held = not (fading or any(effects.load) or effects.torque_ripple > 0.0)
    return math.inf if held else GRAIN_S


def finest(inertia: float, stiffness: float) -> float:
    """Return the longest substep [s] with torques that change so much a radian [N·m/rad], > 0."""
    return max(min(GRAIN_S, PHASE * math.sqrt(inertia / stiffness)), SHORTEST_S)


def fall_of(exponent: float) -> float:
    """Return the largest change of speed in Stribeck speeds with this exponent of the fall."""
    if exponent < 1.0:  # it is steep at the start
        return math.pow(FALL, 1.0 / exponent)
    return FALL / exponent


class Substeps:
    """Moves one body with these effects."""

    __slots__ = (
        "_angle",
        "_back",
        "_cogging",
        "_coulomb",
        "_excess",
        "_exponent",
        "_faded",
        "_fading",
        "_fall",
        "_fineness",
        "_forth",
        "_grain",
        "_gravity",
        "_inertia",
        "_load",
        "_loaded",
        "_periods",
        "_phase",
        "_ripple",
        "_ripple_periods",
        "_ripple_phase",
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
        self._exponent = effects.stribeck_exponent
        self._faded = self._stribeck * FADED ** (1.0 / self._exponent)
        self._load, self._loaded = effects.load, any(effects.load)
        self._fading = (self._excess > 0.0 or self._load.fades) and self._stribeck > 0.0
        self._gravity, self._angle = effects.gravity, effects.gravity_angle
        self._cogging, self._periods = effects.cogging, effects.cogging_periods
        self._phase = effects.cogging_phase
        self._ripple, self._ripple_periods = effects.torque_ripple, effects.torque_ripple_periods
        self._ripple_phase = effects.torque_ripple_phase
        self._fineness = fineness
        self._grain = grain_of(parameters.inertia, effects, fading=self._fading) / fineness
        self._teeth, self._fall = TEETH / fineness, fall_of(self._exponent) / fineness

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
            parameters: Parameters as given at the start, but for more damping: that is the fall of
                the motor's torque with the velocity.
            torque: Torque of the motor at rest, held over the whole step [N·m].
            duration: Length of the step [s], >= 0.
            pull: The operator; None: no operator.
            turns: If given, the positions [rad] at which the velocity reached zero are appended.
        """
        position, velocity = state
        braking = parameters.damping - self._forth
        hand = _NOBODY if pull is None else pull
        left = duration
        longest = self._grain
        if self._ripple > 0.0:
            stiffness = self._gravity + self._cogging * self._periods
            stiffness += self._ripple * self._ripple_periods * abs(torque)
            if stiffness > 0.0:
                longest = finest(self._inertia, stiffness) / self._fineness
        grain = duration / max(1, math.ceil(duration / longest - 1e-9))
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
        if self._ripple > 0.0:
            torque *= 1.0 + self._ripples(position)
        push = torque + outside + self._cogs(position)
        load, most = self._load, self._static
        if self._loaded:
            most += load.in_motion(torque, outside) + load.at_rest(torque, outside)
        if abs(push) > most:
            return math.copysign(1.0, push), 0.0
        ramp = stiffness * slope
        if ramp == 0.0:
            return 0.0, 0.0
        direction = math.copysign(1.0, ramp)
        if self._loaded:
            within = abs(ramp) * left
            grown = load.until_breakaway(push, self._static, torque, outside, direction, within)
        else:
            grown = max(most - direction * push, 0.0)
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
        """Return the motion under held torques, and how long it is accurate [s]."""
        stiffness, grip, reference, slope = hand
        inertia, load, loaded = self._inertia, self._load, self._loaded
        viscous = (self._forth if direction > 0.0 else self._back) + braking
        pulled = stiffness * (reference - position) + grip * slope
        speed = abs(velocity)
        weight = -self._gravity * math.sin(position - self._angle)
        motor, excess = torque - braking * velocity, self._excess
        ripple = motor * self._ripples(position) if self._ripple > 0.0 else 0.0
        friction = self._coulomb
        if loaded:
            motor, external = motor + ripple, pulled - grip * velocity + weight
            friction += load.in_motion(motor, external)
            excess += load.at_rest(motor, external)
        if self._fading:
            friction += excess * self._left(speed)
        push = torque + pulled + weight + ripple + self._cogs(position) - direction * friction
        gain = (push - (viscous + grip) * velocity) / inertia
        length = min(most, self._length(most, speed, gain, excess))

        half = 0.5 * length
        middle = position + half * velocity
        pace = velocity + half * gain
        if pace * direction < 0.0:
            pace = 0.0
        weight = -self._gravity * math.sin(middle - self._angle)
        motor = torque - braking * pace
        ripple = motor * self._ripples(middle) if self._ripple > 0.0 else 0.0
        friction, excess = self._coulomb, self._excess
        if loaded:
            held = stiffness * (reference + slope * half - middle) + grip * (slope - pace)
            friction += load.in_motion(motor + ripple, held + weight)
            excess += load.at_rest(motor + ripple, held + weight)
        if self._fading:
            friction += excess * self._left(abs(pace))
        push = torque + pulled + weight + ripple + self._cogs(middle) - direction * friction
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

    def _ripples(self, position: float) -> float:
        return self._ripple * math.sin(self._ripple_periods * position + self._ripple_phase)

    def _left(self, speed: float) -> float:
        """Return the fraction of the static friction's excess that is left at this speed."""
        if speed > self._faded:
            return 0.0
        if self._exponent == 1.0:
            return math.exp(-speed / self._stribeck)
        return math.exp(-((speed / self._stribeck) ** self._exponent))

    def _length(self, grain: float, speed: float, gain: float, excess: float) -> float:
        """Return the longest substep at this speed [rad/s], acceleration [rad/s²], excess [N·m]."""
        if self._cogging > 0.0 and self._periods * speed * grain > self._teeth:
            grain = max(self._teeth / (self._periods * speed), SHORTEST_S)
        if self._ripple > 0.0 and self._ripple_periods * speed * grain > self._teeth:
            grain = max(self._teeth / (self._ripple_periods * speed), SHORTEST_S)
        if not self._fading or excess == 0.0:
            return grain
        # The error of a substep goes with the square of the change and with what is left of the
        # excess: the further it has faded, the longer the substep. Twice: the speed changes in it.
        change = self._fall * self._stribeck
        rate = abs(gain)
        length, slower = grain, speed
        for _ in range(2):
            if slower > self._faded:
                return length
            left = math.sqrt(self._left(slower))
            steepest = excess / self._inertia * left * left
            length = min(grain, change / (left * (rate + steepest)))
            slower = max(speed - rate * length, 0.0)
        return max(length, SHORTEST_S)


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
