"""Moves a servo whose load lies behind a flexible transmission: two masses, friction on one.

The motion solves, with the motor's position x, the output's y and the transmitted torque F ::

    J_m x'' = u - A sin(N x + phase) - b x' - F - friction(x', u + F)
    J_l y'' = F - G sin(y - angle) + k_h (r - y) + b_h (r' - y')
    F       = k (x - y) + c (x' - y')

With backlash between the masses F is counted from the end of the backlash, only pushes, and is 0
within it. While the motor keeps its direction, or sticks, and the transmission its contact, the
equations are linear: matrix exponentials solve them exactly for any duration. An event (the motor
stops or breaks away, a contact begins or ends) is found to the nanosecond. Events are looked for at
the ends of substeps, so one that is undone within a substep is missed. Weight, cogging and friction
that falls with the speed are held over a substep at the values of its middle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from haptic_wall.hw.errors import SpecError
from haptic_wall.hw.plant.body import PlantParameters, Pull, State
from haptic_wall.hw.plant.effects import Effects
from haptic_wall.hw.plant.linear_motion import Inputs, Moving, linear_motion
from haptic_wall.hw.plant.substeps import FADED, FALL, GRAIN_S, PHASE, TEETH
from haptic_wall.hw.settings import TrueServo

TURN = 0.5
"""Longest substep, in radians of the transmission's oscillation"""
LONGEST_S = 5e-4
"""Longest substep between looks for events [s]"""
FINEST_NS = 50_000
"""Substeps do not get shorter than this [ns]; events do"""
_ENDLESS = 10**18


class TwoMasses:
    """Moves one servo with a load behind a transmission."""

    __slots__ = (
        "_cogs",
        "_coulomb",
        "_damping",
        "_divided",
        "_effects",
        "_excess",
        "_fall",
        "_gap",
        "_grain",
        "_inertia",
        "_load_inertia",
        "_static",
        "_stiffness",
        "_teeth",
        "_uneven",
        "_viscous",
    )

    def __init__(self, true: TrueServo, *, fineness: float = 1.0) -> None:
        """Prepare for a servo.

        Args:
            true: Its true parameters, with a transmission.
            fineness: Every substep is shortened by this factor, to see how the error falls.

        Raises:
            ValueError: A value is out of range.
        """
        for name in ("load_inertia", "transmission_stiffness"):
            if not 0.0 < getattr(true, name) < math.inf:
                raise SpecError(
                    f"{name} is {getattr(true, name)}",
                    advice="give load_inertia and transmission_stiffness finite values above 0, or"
                    " neither",
                )
        if not 0.0 <= true.transmission_damping < math.inf:
            raise SpecError(
                f"transmission_damping is {true.transmission_damping}",
                advice="give a finite value from 0 up",
            )
        effects = Effects.of(true)
        self._inertia, self._load_inertia = true.inertia, true.load_inertia
        self._stiffness, self._damping = true.transmission_stiffness, true.transmission_damping
        back = effects.damping_back
        self._viscous = (true.damping, true.damping if back is None else back)
        self._coulomb, self._static = true.coulomb, effects.breakaway(true.coulomb)
        self._excess = self._static - self._coulomb if effects.stribeck_speed > 0.0 else 0.0
        self._gap = 0.5 * true.backlash
        self._effects = effects
        self._cogs = effects.cogging * effects.cogging_periods
        self._uneven = self._excess + effects.load_friction + effects.gravity + self._cogs > 0.0
        self._teeth, self._fall = TEETH / fineness, FALL / fineness
        one_way = self._static == 0.0 and self._viscous[0] == self._viscous[1]
        self._divided = self._uneven or self._gap > 0.0 or not one_way
        self._grain = _ENDLESS
        if self._divided:
            rate = math.sqrt(self._stiffness * (1.0 / self._inertia + 1.0 / self._load_inertia))
            seconds = min(GRAIN_S if self._uneven else LONGEST_S, TURN / rate)
            if self._cogs > 0.0:
                seconds = min(seconds, PHASE * math.sqrt(self._inertia / self._cogs))
            if effects.gravity > 0.0:
                seconds = min(seconds, PHASE * math.sqrt(self._load_inertia / effects.gravity))
            self._grain = _kept_length(round(max(seconds * 1e9, FINEST_NS) / fineness))

    # In one piece for speed: every period of such a servo takes it.
    def step(  # noqa: PLR0915
        self,
        motor: State,
        output: State,
        parameters: PlantParameters,
        torque: float,
        length_ns: int,
        pull: Pull | None = None,
    ) -> tuple[State, State]:
        """Return the states of motor and output after a time under a held torque.

        Args:
            motor: State of the motor's side at the start.
            output: State of the output.
            parameters: Of the motor's side as given at the start, but for more damping: that is the
                fall of the motor's torque with its velocity.
            torque: Of the motor at rest, held over the whole step [N·m].
            length_ns: Length of the step [ns], >= 0.
            pull: The operator, at the output; None: no operator.
        """
        (x, v), (y, w) = motor, output
        effects = self._effects
        braking = parameters.damping - self._viscous[0]
        reference = y if pull is None else pull.reference
        hand_stiffness, hand_damping, _, slope = _NOBODY if pull is None else pull
        stretch, left = reference - y, length_ns
        while left:
            twist = x - y
            side = self._contact(twist, v - w)
            stiffness, damping = (self._stiffness, self._damping) if side else (0.0, 0.0)
            ahead = side * self._gap * stiffness
            passed = stiffness * twist - ahead + damping * (v - w)
            push, weight = torque + effects.cogging_at(x), effects.weight_at(y)
            still = v == 0.0 and abs(push - passed) <= self._static + self._load(torque, passed)
            direction = 0.0 if still else math.copysign(1.0, v or push - passed)
            viscous = self._viscous[direction < 0.0] + braking
            motion = linear_motion(
                self._inertia,
                self._load_inertia,
                stiffness,
                damping,
                viscous,
                hand_stiffness,
                hand_damping,
                still and self._divided,
            )
            friction = direction * self._in_motion(abs(v), torque, passed)
            now = Moving(twist, v, w, stretch)
            held = Inputs(push - friction + ahead, weight - ahead, slope)
            longest = min(left, self._grain)
            if self._uneven:
                gain = (push - passed - friction - viscous * v) / self._inertia
                longest = min(longest, self._longest(abs(v), abs(gain)))
                took = _kept_length(longest)
                half = _kept_length(max(took // 2, 1))
                middle = motion.after(now, held, half)
                there = y + slope * half * 1e-9 + stretch - middle.stretch
                passed = stiffness * middle.twist - ahead + damping * (middle.motor - middle.output)
                push, weight = (
                    torque + effects.cogging_at(there + middle.twist),
                    effects.weight_at(there),
                )
                friction = direction * self._in_motion(abs(middle.motor), torque, passed)
                if v == 0.0 and direction * (push - friction - passed) < 0.0:
                    friction = push - passed  # it breaks away just now
                held = Inputs(push - friction + ahead, weight - ahead, slope)
            if not self._divided or longest == self._grain:
                took = _kept_length(longest)
                after = motion.after(now, held, took)
            else:
                took = longest
                after = motion.course(now, held, took).at(took)
            if self._divided:
                ends = self._ends(after, direction, side, push, ahead, torque)
                if ends:
                    course = motion.course(now, held, took)
                    took = min(max(course.until(*value) for value in each) for each in ends)
                    after = course.at(took)
                v = after.motor if direction * after.motor > 0.0 else 0.0
            else:
                v = after.motor
            w = after.output
            y += slope * took * 1e-9 + stretch - after.stretch
            x, stretch = y + after.twist, after.stretch
            left -= took
        return State(x, v), State(y, w)

    def _ends(
        self,
        after: Moving,
        direction: float,
        side: int,
        push: float,
        ahead: float,
        torque: float,
    ) -> list[Sequence[tuple[float, float, float, float]]]:
        """Return the conditions of the present motion that do not hold after a step.

        Each is one or two values of which one must stay positive: a constant, and multiples of
        twist, the motor's speed and the output's.
        """
        stiffness, damping, gap = self._stiffness, self._damping, self._gap
        twist, motor, output, _ = after
        ends: list[Sequence[tuple[float, float, float, float]]] = []
        passed = 0.0
        if side:
            passed = stiffness * twist - ahead + damping * (motor - output)
            if gap and side * passed <= 0.0:
                rate = side * damping
                ends.append(((-side * ahead, side * stiffness, rate, -rate),))
        elif touched := self._contact(twist, motor - output):
            deep = gap, -float(touched), 0.0, 0.0
            rate = touched * damping
            ends.append((deep, (stiffness * gap, -touched * stiffness, -rate, rate)))
        if direction:
            if direction * motor <= 0.0:
                ends.append(((0.0, 0.0, direction, 0.0),))
            return ends
        most = self._static + self._load(torque, passed)
        if abs(push - passed) > most:
            sign = math.copysign(1.0, push - passed)
            if not side:
                stiffness = damping = 0.0
            ends.append(((most - sign * (push + ahead), sign * stiffness, 0.0, -sign * damping),))
        return ends

    def _contact(self, twist: float, rate: float) -> int:
        """Return the side on which the transmission pushes; 0: it is within its backlash."""
        if self._gap == 0.0:
            return 1
        side = 1 if twist > 0.0 else -1
        deep = side * twist - self._gap
        pushes = deep > 0.0 and self._stiffness * deep + self._damping * side * rate > 0.0
        return side if pushes else 0

    def _load(self, torque: float, passed: float) -> float:
        return self._effects.load_friction * abs(torque + passed)

    def _in_motion(self, speed: float, torque: float, passed: float) -> float:
        """Return the friction in motion [N·m]."""
        friction = self._coulomb + self._load(torque, passed)
        scale = self._effects.stribeck_speed
        if self._excess > 0.0 and speed < FADED * scale:
            friction += self._excess * math.exp(-speed / scale)
        return friction

    def _longest(self, speed: float, gain: float) -> int:
        """Return the longest substep at this speed [rad/s] and acceleration [rad/s²], in ns."""
        seconds, effects = GRAIN_S, self._effects
        if self._cogs > 0.0 and speed > 0.0:
            seconds = min(seconds, self._teeth / (effects.cogging_periods * speed))
        scale = effects.stribeck_speed
        if self._excess > 0.0 and speed < FADED * scale:
            left = math.exp(-0.5 * speed / scale)
            steepest = gain + self._excess / self._inertia * left * left
            seconds = min(seconds, self._fall * scale / (left * steepest))
        return max(round(seconds * 1e9), 100)


_NOBODY = Pull(0.0, 0.0, 0.0, 0.0)


def _kept_length(length_ns: int) -> int:
    """Return the first digit of a length, and zeros: few lengths have their responses kept."""
    text = str(length_ns)
    return int(text[0] + "0" * (len(text) - 1))
