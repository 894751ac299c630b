"""Simulates a servo with its load behind a flexible transmission: two masses, friction on one.

The motion solves, with the motor's position x, the output's y and the transmitted torque F ::

    J_m x'' = u - A sin(N x + phase) - b x' - F - friction(x', u, -F)
    J_l y'' = F - G sin(y - angle) + k_h (r - y) + b_h (r' - y')
    F       = k (x - y) + c (x' - y')

With backlash between the masses F is counted from the end of the backlash, only pushes, and is 0
within it. While the motor keeps its direction, or sticks, and the transmission its contact, the
equations are linear: matrix exponentials solve them exactly for any duration. An event (the motor
stops or breaks away, a contact begins or ends) is found to the nanosecond. Events are looked for at
the ends of substeps, so one that is undone within a substep is missed. Weight, cogging, ripple and
friction that depends on speed or load are held over a substep at the values of its middle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from haptic_wall.hw.errors import SpecError
from haptic_wall.hw.plant.body import PlantParameters, Pull, State
from haptic_wall.hw.plant.effects import Effects
from haptic_wall.hw.plant.linear_motion import Inputs, Moving, linear_motion
from haptic_wall.hw.plant.substeps import FADED, GRAIN_S, PHASE, TEETH, fall_of
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
        "_faded",
        "_fall",
        "_gap",
        "_grain",
        "_inertia",
        "_load",
        "_load_inertia",
        "_loaded",
        "_ripples",
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
        import scipy.linalg  # noqa: F401 - here, or the first step takes as long as ten replies

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
        self._ripples = effects.torque_ripple * effects.torque_ripple_periods
        self._load, self._loaded = effects.load, any(effects.load)
        self._faded = effects.stribeck_speed * FADED ** (1.0 / effects.stribeck_exponent)
        uneven = self._excess + effects.gravity + self._cogs + self._ripples
        self._uneven = uneven > 0.0 or self._loaded
        self._teeth, self._fall = TEETH / fineness, fall_of(effects.stribeck_exponent) / fineness
        one_way = self._static == 0.0 and self._viscous[0] == self._viscous[1]
        self._divided = self._uneven or self._gap > 0.0 or not one_way
        self._grain = _ENDLESS
        if self._divided:
            rate = math.sqrt(self._stiffness * (1.0 / self._inertia + 1.0 / self._load_inertia))
            seconds = min(GRAIN_S if self._uneven else LONGEST_S, TURN / rate)
            cogs = self._cogs + self._ripples * true.torque_limit
            if cogs > 0.0:
                seconds = min(seconds, PHASE * math.sqrt(self._inertia / cogs))
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
            parameters: Parameters of the motor's side as given at the start, but for more damping:
                that is the fall of the motor's torque with its velocity.
            torque: Torque of the motor at rest, held over the whole step [N·m].
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
            motor_torque = torque - braking * v
            ripple = motor_torque * effects.ripple_at(x)
            push, weight = torque + ripple + effects.cogging_at(x), effects.weight_at(y)
            made = motor_torque + ripple
            still = v == 0.0 and abs(push - passed) <= self._most(made, passed)
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
            friction, excess = self._friction(abs(v), made, passed)
            friction *= direction
            now = Moving(twist, v, w, stretch)
            held = Inputs(push - friction + ahead, weight - ahead, slope)
            longest = min(left, self._grain)
            if self._uneven:
                gain = (push - passed - friction - viscous * v) / self._inertia
                longest = min(longest, self._longest(abs(v), abs(gain), excess))
                took = _kept_length(longest)
                half = _kept_length(max(took // 2, 1))
                middle = motion.after(now, held, half)
                there = y + slope * half * 1e-9 + stretch - middle.stretch
                passed = stiffness * middle.twist - ahead + damping * (middle.motor - middle.output)
                at = there + middle.twist
                motor_torque = torque - braking * middle.motor
                ripple = motor_torque * effects.ripple_at(at)
                made = motor_torque + ripple
                push = torque + ripple + effects.cogging_at(at)
                weight = effects.weight_at(there)
                friction = direction * self._friction(abs(middle.motor), made, passed)[0]
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
                ends = self._ends(after, direction, side, push, ahead, made)
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
        made: float,
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
        most = self._most(made, passed)
        if abs(push - passed) > most:
            sign = math.copysign(1.0, push - passed)
            # The load grows with the transmitted torque, in proportion but for its few corners.
            grown = self._load.slope(made, -passed) if self._loaded else 0.0
            lever = sign - grown
            if not side:
                stiffness = damping = ahead = 0.0
            rest = most + grown * passed - sign * push - lever * ahead
            ends.append(((rest, lever * stiffness, 0.0, -lever * damping),))
        return ends

    def _contact(self, twist: float, rate: float) -> int:
        """Return the side on which the transmission pushes; 0: it is within its backlash."""
        if self._gap == 0.0:
            return 1
        side = 1 if twist > 0.0 else -1
        deep = side * twist - self._gap
        pushes = deep > 0.0 and self._stiffness * deep + self._damping * side * rate > 0.0
        return side if pushes else 0

    def _most(self, made: float, passed: float) -> float:
        """Return the largest friction at rest [N·m]."""
        if not self._loaded:
            return self._static
        load = self._load
        return self._static + load.in_motion(made, -passed) + load.at_rest(made, -passed)

    def _friction(self, speed: float, made: float, passed: float) -> tuple[float, float]:
        """Return the friction in motion, and the excess of that at rest [N·m]."""
        friction, excess = self._coulomb, self._excess
        scale = self._effects.stribeck_speed
        if self._loaded:
            friction += self._load.in_motion(made, -passed)
            if scale > 0.0:
                excess += self._load.at_rest(made, -passed)
        if excess > 0.0 and speed < self._faded:
            friction += excess * math.exp(-((speed / scale) ** self._effects.stribeck_exponent))
        return friction, excess

    def _longest(self, speed: float, gain: float, excess: float) -> int:
        """Return the longest substep [ns] at this speed, acceleration and excess of friction."""
        seconds, effects = GRAIN_S, self._effects
        if self._cogs > 0.0 and speed > 0.0:
            seconds = min(seconds, self._teeth / (effects.cogging_periods * speed))
        if self._ripples > 0.0 and speed > 0.0:
            seconds = min(seconds, self._teeth / (effects.torque_ripple_periods * speed))
        scale = effects.stribeck_speed
        if excess > 0.0 and speed < self._faded:
            left = math.exp(-0.5 * (speed / scale) ** effects.stribeck_exponent)
            steepest = gain + excess / self._inertia * left * left
            seconds = min(seconds, self._fall * scale / (left * steepest))
        return max(round(seconds * 1e9), 100)


_NOBODY = Pull(0.0, 0.0, 0.0, 0.0)


def _kept_length(length_ns: int) -> int:
    """Return the first digit of a length, and zeros: few lengths have their responses kept."""
    text = str(length_ns)
    return int(text[0] + "0" * (len(text) - 1))
