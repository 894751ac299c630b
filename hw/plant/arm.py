"""Couples two servos whose shafts are the joints of one arm: they move together, in steps for both.

The arm has two links in a horizontal plane, with a point mass at the end of each. The second angle
is that between the links: 0 is a stretched arm, and pi a folded one. With q the positions of the
shafts, the whole equation of motion is ::

    (M(q) + diag(m)) q'' + h(q, q') = e

M and h are the links': their inertia, and their Coriolis and centrifugal torques. m and e are each
servo's own: its inertia, and what ``haptic_wall.hw.plant.mechanics`` says beside it.

A step is the implicit midpoint of a Störmer-Verlet step: M and all torques are those of its middle.
It is symmetric in time and of second order, so that it neither feeds nor drains an oscillation.
Friction is an impulse against the motion of at most its bound; a joint that it can stop is at rest.

Source: Spong, Hutchinson, Vidyasagar, "Robot Modeling and Control" (2006), section 7.5 (the links).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from haptic_wall.hw.errors import SpecError
from haptic_wall.hw.plant.mechanics import (
    GRAIN_S,
    cogging_at,
    finest,
    friction_at,
    most_friction,
    weight_at,
)
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.truth import TrueArm

_PASSES: Final = 2
"""Evaluations of what depends on the velocity in the middle of a step; the first predicts it"""


def inertia_of(true: TrueArm, bend: float) -> list[list[float]]:
    """Return M, 2 x 2 [kg·m²], at an angle between the links [rad]."""
    outer = true.mass_2 * true.length_2**2
    both = outer + _lever(true) * math.cos(bend)
    whole = (true.mass_1 + true.mass_2) * true.length_1**2 - outer + 2.0 * both
    return [[whole, both], [both, outer]]


def bias_of(true: TrueArm, bend: float, velocities: Sequence[float]) -> tuple[float, float]:
    """Return h, 2 [N·m], at an angle between the links [rad] and velocities [rad/s]."""
    first, second = velocities
    lever = _lever(true) * math.sin(bend)
    return -lever * second * (2.0 * first + second), lever * first * first


def _lever(true: TrueArm) -> float:
    return true.mass_2 * true.length_1 * true.length_2


class Arm:
    """Moves the servos of an arm; from now on none of them moves without the other.

    Args:
        true: The links.
        mechanisms: The two servos in the order of the joints, at the same time, both rigid.
    """

    def __init__(self, true: TrueArm, mechanisms: Sequence[Mechanism]) -> None:
        self._true = true
        self._mechanisms = tuple(mechanisms)
        self._loads = [0.0, 0.0]
        """Torque of links and operator on each gear in the last step [N·m]"""
        self._gains = [0.0, 0.0]
        """Accelerations in the last step [rad/s²]"""
        for mechanism in self._mechanisms:
            mechanism.arm = self.advance

    def advance(self, now_ns: int) -> None:
        """Advance both servos to ``now_ns`` [ns]."""
        mechanisms = self._mechanisms
        time_ns = mechanisms[0].time_ns
        while True:
            turns_ns = [mechanism.begin() for mechanism in mechanisms]
            if time_ns >= now_ns:
                return
            time_ns = min(now_ns, time_ns + self._grain_ns(), *turns_ns)
            self._step(time_ns)

    def _grain_ns(self) -> int:
        """Return the longest next step [ns]."""
        grain = GRAIN_S
        for mechanism in self._mechanisms:
            numbers, stiffness = mechanism.mechanics, mechanism.held.stiffness
            grain = min(grain, numbers.grain)
            if stiffness > 0.0:
                grain = min(grain, finest(numbers.inertia, stiffness))
        return max(1, round(grain * 1e9))

    def _step(self, until_ns: int) -> None:
        """Move both servos to ``until_ns`` [ns], under what acts now."""
        mechanisms, true = self._mechanisms, self._true
        duration = (until_ns - mechanisms[0].time_ns) * 1e-9
        half = 0.5 * duration
        v = [each.velocity for each in mechanisms]
        middle = [each.position + half * each.velocity for each in mechanisms]
        matrix = inertia_of(true, middle[1])
        impulses, motors = [], []
        for i, each in enumerate(mechanisms):
            p, hand, row, x = each.mechanics, each.held, matrix[i], middle[i]
            torque, braking = each.drives(until_ns)
            own = torque + cogging_at(p, x)
            viscous = (p.forth if v[i] >= 0.0 else p.back) + braking
            pull = hand.stiffness * (hand.reference + half * hand.slope - x)
            push = own + weight_at(p, x) + pull + hand.damping * hand.slope
            row[i] += p.inertia
            damping = half * (viscous + hand.damping)
            momentum = sum(map(float.__mul__, row, v))
            impulses.append(momentum + duration * push - damping * v[i])
            row[i] += damping
            motors.append((own, torque, braking, viscous))
        paces = [speed + half * gain for speed, gain in zip(v, self._gains, strict=True)]
        for _ in range(_PASSES):
            pushes = [
                impulse - duration * bias
                for impulse, bias in zip(impulses, bias_of(true, middle[1], paces), strict=True)
            ]
            bounds = []
            for i, each in enumerate(mechanisms):
                _, torque, braking, _ = motors[i]
                made, load = torque - braking * paces[i], self._loads[i]
                if v[i] == 0.0:
                    bound = most_friction(each.mechanics, made, load)
                else:
                    bound = friction_at(each.mechanics, abs(paces[i]), made, load)
                bounds.append(duration * bound)
            end, friction = _with_friction(matrix, pushes, bounds, v)
            paces = [0.5 * (before + after) for before, after in zip(v, end, strict=True)]
        self._gains = [(new - old) / duration for old, new in zip(v, end, strict=True)]
        for i, each in enumerate(mechanisms):
            own, _, _, viscous = motors[i]
            held = each.mechanics.inertia * self._gains[i] + viscous * paces[i]
            self._loads[i] = held + friction[i] / duration - own
            each.place(middle[i] + half * end[i], end[i], until_ns)


def couple(true: TrueArm | None, mechanisms: Sequence[Mechanism]) -> None:
    """Make the first servos of a bus an arm, where there is one.

    Raises:
        SpecError: There are too few servos, or one has a flexible transmission.
    """
    if true is None or true.shape == "none":
        return
    if len(mechanisms) < 2:
        raise SpecError(
            f"found {len(mechanisms)} servo", field="arm.shape", wanted="two servos for two links"
        )
    if any(mechanism.flexible for mechanism in mechanisms[:2]):
        raise SpecError(
            "a servo of an arm has a flexible transmission, which is not simulated",
            field="servo.load_inertia",
            wanted="0",
        )
    Arm(true, mechanisms[:2])


def _with_friction(
    matrix: list[list[float]], impulses: list[float], bounds: list[float], v: list[float]
) -> tuple[list[float], list[float]]:
    """Return the velocities after a step, and the impulses of friction, against each motion.

    It solves ``matrix end = impulses - friction`` where friction is ``bound`` times the direction
    of a joint that moves, and at most the bound at one that rests. The first joint that contradicts
    its assumption changes it, until none does.

    Source: Murty, "Linear Complementarity, Linear and Nonlinear Programming" (1988), section 3.1.
    """
    ways = [0.0 if speed == 0.0 else math.copysign(1.0, speed) for speed in v]
    while True:
        friction = [way * bound for way, bound in zip(ways, bounds, strict=True)]
        pushes = [impulse - held for impulse, held in zip(impulses, friction, strict=True)]
        moving = [bool(way) or bound == 0.0 for way, bound in zip(ways, bounds, strict=True)]
        end = _solved(matrix, pushes, moving)
        for i, bound in enumerate(bounds):
            if bound == 0.0:
                continue
            if ways[i]:
                if ways[i] * end[i] < 0.0:
                    ways[i] = 0.0
                    break
            else:
                friction[i] = impulses[i] - sum(map(float.__mul__, matrix[i], end))
                if abs(friction[i]) > bound * (1.0 + 1e-12):
                    ways[i] = math.copysign(1.0, friction[i])
                    break
        else:
            return end, friction


def _solved(matrix: list[list[float]], pushes: list[float], moving: Sequence[bool]) -> list[float]:
    """Return the velocities of the joints by these impulses; a joint that does not move has 0."""
    (first, both), (_, second) = matrix
    if not moving[0]:
        return [0.0, pushes[1] / second if moving[1] else 0.0]
    if not moving[1]:
        return [pushes[0] / first, 0.0]
    share = both / first
    end = (pushes[1] - share * pushes[0]) / (second - share * both)
    return [(pushes[0] - both * end) / first, end]
