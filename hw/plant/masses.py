"""Simulates a servo with a load behind a flexible transmission: masses in a chain, friction on one.

The motion solves, with the motor's position x, the output's y and the transmitted torque F ::

    J_m x'' = u - A sin(N x + phase) - b x' - F - friction(x', u, -F)
    J_l y'' = F - G sin(y - angle) + k_h (r - y) + b_h (r' - y')
    F       = k (x - y) + c (x' - y')

Further masses follow the output on linear joints; operator and weight are then at the last one.

With backlash between motor and output F is counted from the end of the backlash, only pushes, and
is 0 within it. While the motor keeps its direction, or sticks, and the transmission its contact,
the equations are linear: matrix exponentials solve them exactly for any duration. An event (the
motor stops or breaks away, a contact begins or ends) is found to the nanosecond. Events are looked
for at the ends of substeps, so one that is undone within a substep is missed. Weight, cogging,
ripple and friction that depends on speed or load are held over a substep at the values of its
middle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from haptic_wall.hw.errors import SpecError
from haptic_wall.hw.plant.body import PlantParameters, Pull, State
from haptic_wall.hw.plant.effects import Effects
from haptic_wall.hw.plant.linear_motion import LinearMotion, linear_motion
from haptic_wall.hw.plant.substeps import FADED, GRAIN_S, PHASE, TEETH, fall_of
from haptic_wall.hw.settings import Link, TrueServo, vibrations

TURN = 0.5
"""Longest substep, in radians of the transmission's oscillation"""
LONGEST_S = 5e-4
"""Longest substep between looks for events [s]"""
FINEST_NS = 50_000
"""Substeps do not get shorter than this [ns]; events do"""
_ENDLESS = 10**18
_MOTIONS = 64
"""Most linear motions that are at hand"""
_NAMES = "load_inertia", "transmission_stiffness", "transmission_damping"


class Masses:
    """Moves one servo with a load, or a chain of them, behind a transmission."""

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
        "_links",
        "_load",
        "_loaded",
        "_loose",
        "_motions",
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

        for number, link in enumerate(true.links):
            names = _NAMES if number == 0 else tuple(f"{each} of chain" for each in Link._fields)
            for name, value in zip(names[:2], link[:2], strict=True):
                if not 0.0 < value < math.inf:
                    raise SpecError(
                        f"{name} is {value}",
                        advice="give each mass behind the motor a finite inertia above 0, and its"
                        " joint a finite stiffness above 0",
                    )
            if not 0.0 <= link.damping < math.inf:
                raise SpecError(
                    f"{names[2]} is {link.damping}", advice="give a finite value from 0 up"
                )
        effects = Effects.of(true)
        self._inertia, self._links = true.inertia, true.links
        self._loose = (Link(true.load_inertia, 0.0, 0.0), *true.chain)
        self._stiffness, self._damping = true.transmission_stiffness, true.transmission_damping
        back = effects.damping_back
        self._viscous = (true.damping, true.damping if back is None else back)
        self._coulomb, self._static = true.coulomb, effects.breakaway(true.coulomb)
        self._excess = self._static - self._coulomb if effects.stribeck_speed > 0.0 else 0.0
        self._gap = 0.5 * true.backlash
        self._motions: dict[tuple[bool, float, float, float, bool], LinearMotion] = {}
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
            rate = vibrations(self._inertia, self._links)[-1].rate
            seconds = min(GRAIN_S if self._uneven else LONGEST_S, TURN / rate)
            cogs = self._cogs + self._ripples * true.torque_limit
            if cogs > 0.0:
                seconds = min(seconds, PHASE * math.sqrt(self._inertia / cogs))
            if effects.gravity > 0.0:
                end = self._links[-1].inertia
                seconds = min(seconds, PHASE * math.sqrt(end / effects.gravity))
            self._grain = _kept_length(round(max(seconds * 1e9, FINEST_NS) / fineness))

    # In one piece for speed: every period of such a servo takes it.
    def step(  # noqa: PLR0915
        self,
        masses: Sequence[State],
        parameters: PlantParameters,
        torque: float,
        length_ns: int,
        pull: Pull | None = None,
    ) -> tuple[State, ...]:
        """Return the states of the masses, from the motor on, after a time under a held torque.

        Args:
            masses: States of motor, output and further masses at the start.
            parameters: Parameters of the motor's side as given at the start, but for more damping:
                that is the fall of the motor's torque with its velocity.
            torque: Torque of the motor at rest, held over the whole step [N·m].
            length_ns: Length of the step [ns], >= 0.
            pull: The operator, at the last mass; None: no operator.
        """
        effects = self._effects
        braking = parameters.damping - self._viscous[0]
        x, end = masses[0].position, masses[-1].position
        reference = end if pull is None else pull.reference
        hand_stiffness, hand_damping, _, slope = _NOBODY if pull is None else pull
        now = [masses[0].velocity]
        for before, mass in pairwise(masses):
            now += before.position - mass.position, mass.velocity
        now.append(reference - end)
        left = length_ns
        while left:
            v, twist, w = now[:3]
            side = self._contact(twist, v - w)
            stiffness, damping = (self._stiffness, self._damping) if side else (0.0, 0.0)
            ahead = side * self._gap * stiffness
            passed = stiffness * twist - ahead + damping * (v - w)
            motor_torque = torque - braking * v
            ripple = motor_torque * effects.ripple_at(x)
            push, weight = torque + ripple + effects.cogging_at(x), effects.weight_at(end)
            made = motor_torque + ripple
            still = v == 0.0 and abs(push - passed) <= self._most(made, passed)
            direction = 0.0 if still else math.copysign(1.0, v or push - passed)
            viscous = self._viscous[direction < 0.0] + braking
            sticks = still and self._divided
            kind = side == 0, viscous, hand_stiffness, hand_damping, sticks
            motion = self._motions.get(kind)
            if motion is None:
                links = self._links if side else self._loose
                motion = linear_motion(self._inertia, links, *kind[1:])
                if len(self._motions) > _MOTIONS:
                    self._motions.clear()
                self._motions[kind] = motion
            friction, excess = self._friction(abs(v), made, passed)
            friction *= direction
            held = push - friction + ahead, -ahead, weight, slope
            longest = min(left, self._grain)
            if self._uneven:
                gain = (push - passed - friction - viscous * v) / self._inertia
                longest = min(longest, self._longest(abs(v), abs(gain), excess))
                took = _kept_length(longest)
                half = _kept_length(max(took // 2, 1))
                middle = motion.after(now, held, half)
                there = end + slope * half * 1e-9 + now[-1] - middle[-1]
                passed = stiffness * middle[1] - ahead + damping * (middle[0] - middle[2])
                at = there + sum(middle[1:-1:2])
                motor_torque = torque - braking * middle[0]
                ripple = motor_torque * effects.ripple_at(at)
                made = motor_torque + ripple
                push = torque + ripple + effects.cogging_at(at)
                weight = effects.weight_at(there)
                friction = direction * self._friction(abs(middle[0]), made, passed)[0]
                if v == 0.0 and direction * (push - friction - passed) < 0.0:
                    friction = push - passed  # it breaks away just now
                held = push - friction + ahead, -ahead, weight, slope
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
                if not direction * after[0] > 0.0:
                    after[0] = 0.0
            end += slope * took * 1e-9 + now[-1] - after[-1]
            now, left = after, left - took
            x = end + sum(now[1:-1:2])
        found = [State(x, now[0])]
        for twist, speed in zip(now[1:-1:2], now[2:-1:2], strict=True):
            found.append(State(found[-1].position - twist, speed))
        return tuple(found)

    def _ends(
        self,
        after: Sequence[float],
        direction: float,
        side: int,
        push: float,
        ahead: float,
        made: float,
    ) -> list[Sequence[tuple[float, float, float, float]]]:
        """Return the conditions of the present motion that do not hold after a step.

        Each is one or two values of which one must stay positive: a constant, and multiples of
        the motor's speed, the twist and the output's speed.
        """
        stiffness, damping, gap = self._stiffness, self._damping, self._gap
        motor, twist, output = after[:3]
        ends: list[Sequence[tuple[float, float, float, float]]] = []
        passed = 0.0
        if side:
            passed = stiffness * twist - ahead + damping * (motor - output)
            if gap and side * passed <= 0.0:
                rate = side * damping
                ends.append(((-side * ahead, rate, side * stiffness, -rate),))
        elif touched := self._contact(twist, motor - output):
            deep = gap, 0.0, -float(touched), 0.0
            rate = touched * damping
            ends.append((deep, (stiffness * gap, -rate, -touched * stiffness, rate)))
        if direction:
            if direction * motor <= 0.0:
                ends.append(((0.0, direction, 0.0, 0.0),))
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
            ends.append(((rest, 0.0, lever * stiffness, -lever * damping),))
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
