"""Couples servos whose shafts are the joints of one arm: they move together, in steps for all.

With q the positions of the shafts, the whole equation of motion is ::

    (M(q) + diag(m)) q'' + h(q, q') = e

M and h are the links': their inertia, and their Coriolis, centrifugal and other torques. m and e
are each servo's own: its inertia, and what ``haptic_wall.hw.plant.mechanics`` says beside it.

A step is the implicit midpoint of a Störmer-Verlet step: M and all torques are those of its middle.
It is symmetric in time and of second order, so that it neither feeds nor drains an oscillation.
Friction is an impulse against the motion of at most its bound; a joint that it can stop is at rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

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


class Links(Protocol):
    """The links of an arm, without the servos' own inertia; any number of joints."""

    def inertia(self, positions: Sequence[float]) -> Sequence[Sequence[float]]:
        """Return M, symmetric and positive semidefinite, n x n [kg·m²]."""
        ...

    def bias(self, positions: Sequence[float], velocities: Sequence[float]) -> Sequence[float]:
        """Return h, n [N·m]: Coriolis and centrifugal torques, and gravity where there is any."""
        ...


@dataclass(frozen=True, slots=True)
class PlanarLinks:
    """Two links in a horizontal plane, with a point mass at the end of each.

    The second angle is that between the links: 0 is a stretched arm, and pi a folded one.

    Source: Spong, Hutchinson, Vidyasagar, "Robot Modeling and Control" (2006), section 7.5.
    """

    length_1: float
    """[m]"""
    length_2: float
    mass_1: float
    """At the end of the first link [kg]"""
    mass_2: float

    def inertia(self, positions: Sequence[float]) -> Sequence[Sequence[float]]:
        """Return M, 2 x 2 [kg·m²]."""
        outer = self.mass_2 * self.length_2**2
        both = outer + self._lever() * math.cos(positions[1])
        whole = (self.mass_1 + self.mass_2) * self.length_1**2 - outer + 2.0 * both
        return (whole, both), (both, outer)

    def bias(self, positions: Sequence[float], velocities: Sequence[float]) -> Sequence[float]:
        """Return h, 2 [N·m]."""
        first, second = velocities
        lever = self._lever() * math.sin(positions[1])
        return -lever * second * (2.0 * first + second), lever * first * first

    def _lever(self) -> float:
        return self.mass_2 * self.length_1 * self.length_2


class Arm:
    """Moves the servos of an arm; from now on none of them moves without the others.

    Args:
        mechanisms: The servos in the order of the joints, at the same time, all rigid.
        links: The links between them.

    Raises:
        SpecError: A servo has a flexible transmission.
    """

    def __init__(self, mechanisms: Sequence[Mechanism], links: Links) -> None:
        self._mechanisms = tuple(mechanisms)
        self._links = links
        self._loads = [0.0] * len(self._mechanisms)
        """Torque of links and operator on each gear in the last step [N·m]"""
        self._gains = self._loads[:]
        """Accelerations in the last step [rad/s²]"""
        for mechanism in self._mechanisms:
            if mechanism.flexible:
                raise SpecError(
                    "a servo of an arm has a flexible transmission, which is not simulated",
                    field="servo.load_inertia",
                    wanted="0",
                )
            mechanism.arm = self.advance

    def advance(self, now_ns: int) -> None:
        """Advance all servos to ``now_ns`` [ns]."""
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
        """Move all servos to ``until_ns`` [ns], under what acts now."""
        mechanisms, links = self._mechanisms, self._links
        duration = (until_ns - mechanisms[0].time_ns) * 1e-9
        half = 0.5 * duration
        v = [each.velocity for each in mechanisms]
        middle = [each.position + half * each.velocity for each in mechanisms]
        matrix = [list(row) for row in links.inertia(middle)]
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
                for impulse, bias in zip(impulses, links.bias(middle, paces), strict=True)
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
    links = PlanarLinks(true.length_1, true.length_2, true.mass_1, true.mass_2)
    Arm(mechanisms[:2], links)


def _with_friction(
    matrix: list[list[float]], impulses: list[float], bounds: list[float], v: list[float]
) -> tuple[list[float], list[float]]:
    """Return the velocities after a step, and the impulses of friction, against each motion.

    It solves ``matrix end = impulses - friction`` where friction is ``bound`` times the direction
    of a joint that moves, and at most the bound at one that rests. The first joint that contradicts
    its assumption changes it, until none does.

    Source: Murty, "Linear Complementarity, Linear and Nonlinear Programming" (1988), section 3.1.
    """
    if not any(bounds):
        return _solved([row[:] for row in matrix], impulses), bounds
    count = len(v)
    ways = [0.0 if speed == 0.0 else math.copysign(1.0, speed) for speed in v]
    while True:
        moving = [i for i in range(count) if ways[i] or bounds[i] == 0.0]
        friction = [way * bound for way, bound in zip(ways, bounds, strict=True)]
        end = [0.0] * count
        solved = _solved(
            [[matrix[i][j] for j in moving] for i in moving],
            [impulses[i] - friction[i] for i in moving],
        )
        for i, speed in zip(moving, solved, strict=True):
            end[i] = speed
        for i in range(count):
            if bounds[i] == 0.0:
                continue
            if ways[i]:
                if ways[i] * end[i] < 0.0:
                    ways[i] = 0.0
                    break
            else:
                friction[i] = impulses[i] - sum(map(float.__mul__, matrix[i], end))
                if abs(friction[i]) > bounds[i] * (1.0 + 1e-12):
                    ways[i] = math.copysign(1.0, friction[i])
                    break
        else:
            return end, friction


def _solved(matrix: list[list[float]], right: list[float]) -> list[float]:
    """Solve a symmetric positive definite system, by elimination."""
    count = len(right)
    for i in range(count):
        row, pivot = matrix[i], matrix[i][i]
        for k in range(i + 1, count):
            share = matrix[k][i] / pivot
            if share:
                below = matrix[k]
                for j in range(i + 1, count):
                    below[j] -= share * row[j]
                right[k] -= share * right[i]
    for i in range(count - 1, -1, -1):
        row = matrix[i]
        rest = right[i]
        for j in range(i + 1, count):
            rest -= row[j] * right[j]
        right[i] = rest / row[i]
    return right
