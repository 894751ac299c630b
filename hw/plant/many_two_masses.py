"""Moves many servos with a load behind a flexible transmission; the array form of ``masses``.

The equations are those of ``haptic_wall.hw.plant.masses`` without an operator model, backlash
and further effects: inertia, viscous and Coulomb friction on the motor's side, a load, stiffness
and damping between them. Matrix exponentials move all servos over substeps of one length. A servo
whose motor stops or breaks away within a substep is moved from event to event, by its power series.
An event that is undone within a substep is missed, as there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_wall.hw.errors import SpecError
from haptic_wall.hw.plant.masses import FINEST_NS, LONGEST_S, TURN

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]

TERMS = 60
"""Largest number of terms of a power series"""
SMALL = 1e-17
"""Terms of a series up to this no longer count [rad, rad/s]"""
LOOKS = 8
"""Parts of a motion between events in which the first event is looked for"""
HALVINGS = 48
"""Halvings of such a part: its last one is shorter than a femtosecond"""
MOST_EVENTS = 32
"""Largest number of events in a substep; then the rest passes without one"""


@dataclass(frozen=True, slots=True)
class Transmissions:
    """Of many servos; arrays of shape (n,)."""

    load_inertia: Floats
    """Inertia of the output, > 0 [kg·m²]; that of the motor's side is the servo's"""
    stiffness: Floats
    """> 0 [N·m/rad]"""
    damping: Floats
    """>= 0 [N·m·s/rad]"""
    on_motor: Bools
    """Whether the encoder measures the motor's side; else the output"""

    def take(self, index: Indices | slice) -> Transmissions:
        """Return the transmissions of the servos at ``index``."""
        return Transmissions(*(getattr(self, field.name)[index] for field in fields(self)))


def substeps(
    inertia: Floats, coulomb: Floats, transmission: Transmissions, duration: Floats
) -> NDArray[np.int64]:
    """Return into how many substeps each servo's motion over ``duration`` [s] is divided.

    Without friction there are no events, and one step of any length is exact.
    """
    ease = 1.0 / inertia + 1.0 / transmission.load_inertia
    grain = np.minimum(LONGEST_S, TURN / np.sqrt(transmission.stiffness * ease))
    grain = np.maximum(grain, 1e-9 * FINEST_NS)
    parts = np.maximum(1.0, np.ceil(duration / grain - 1e-9))
    return np.where(coulomb > 0.0, parts, 1.0).astype(np.int64)


class HeldTwo(NamedTuple):
    """Responses of many servos over one substep."""

    slide: Floats
    """State after it, from the state before and a torque on the motor's side; rows and columns as
    of ``Moving``; shape (4, 4, n)"""
    stick: Floats
    """Twist and speed of the output after it while the motor stands still; shape (2, 2, n)"""
    duration: Floats
    """Length of all substeps together [s], shape (n,)"""
    parts: int
    """Number of substeps"""


class ManyTwoMasses:
    """Many servos with a load, moved in place.

    Attributes:
        position: Of the side that the encoder measures [rad], shape (n,); always the same array.
        velocity: Of the same side [rad/s], shape (n,); always the same array.
        state: Twist [rad], speeds of motor and output [rad/s], position of the output [rad];
            shape (4, n), always the same array.
    """

    __slots__ = ("_parameters", "_transmission", "position", "state", "velocity")

    def __init__(
        self,
        inertia: Floats,
        damping: Floats,
        coulomb: Floats,
        transmission: Transmissions,
        position: Floats,
        velocity: Floats,
    ) -> None:
        """Create servos without twist, whose two sides move alike; arrays of (n,).

        Args:
            inertia: Of the motor's side [kg·m²].
            damping: Viscous friction of the motor's side [N·m·s/rad].
            coulomb: Coulomb friction of the motor's side [N·m].
            transmission: Transmission and load.
            position: Position at the start [rad].
            velocity: Velocity at the start [rad/s].

        Raises:
            ValueError: A value is out of range.
        """
        load, stiffness = transmission.load_inertia, transmission.stiffness
        for name, array, good, wanted in (
            ("inertia", inertia, inertia > 0.0, "above 0"),
            ("damping", damping, damping >= 0.0, "from 0 up"),
            ("coulomb", coulomb, coulomb >= 0.0, "from 0 up"),
            ("load_inertia", load, load > 0.0, "above 0"),
            ("transmission_stiffness", stiffness, stiffness > 0.0, "above 0"),
            ("transmission_damping", transmission.damping, transmission.damping >= 0, "from 0 up"),
        ):
            bad = ~(good & np.isfinite(array))
            if bad.any():
                raise SpecError(f"{name} is {array[bad][0]}", advice=f"give finite values {wanted}")
        self._transmission = transmission
        self._parameters = np.array(
            [inertia, damping, coulomb, load, stiffness, transmission.damping]
        )
        self.state = np.array([0.0 * position, velocity, velocity, position])
        self.position, self.velocity = position.copy(), velocity.copy()

    @property
    def motor_velocity(self) -> Floats:
        """Return the speed of the motor's side [rad/s]."""
        speed: Floats = self.state[1]
        return speed

    @property
    def motor_position(self) -> Floats:
        """Return the position of the motor's side [rad]."""
        position: Floats = self.state[3] + self.state[0]
        return position

    @property
    def rigid_speed(self) -> Floats:
        """Return the speed of rigid servos with the same energy [rad/s]."""
        inertia, _, _, load, stiffness, _ = self._parameters
        twist, motor, output, _ = self.state
        energy = inertia * motor * motor + load * output * output + stiffness * twist * twist
        speed: Floats = np.sqrt(energy / (inertia + load))
        return speed

    def held(self, duration: Floats) -> HeldTwo:
        """Return the responses over this time [s], >= 0, shape (n,)."""
        inertia, _, coulomb, *_ = self._parameters
        parts = int(substeps(inertia, coulomb, self._transmission, duration).max(initial=1))
        length = duration / parts
        cases, each = np.unique(np.vstack([self._parameters, length]), axis=1, return_inverse=True)
        slide, stick = _responses(cases)
        each = each.ravel()
        return HeldTwo(slide[:, :, each], stick[:, :, each], duration, parts)

    def step(
        self,
        torque: Floats,
        over: HeldTwo,
        outside: Floats | float = 0.0,
    ) -> None:
        """Move all servos under torques held for the substeps of ``over``.

        Args:
            torque: Torque of the motors [N·m], shape (n,).
            over: From ``held``.
            outside: Torque of an operator on the motor's side [N·m].
        """
        for _ in range(over.parts):
            self._substep(torque + outside, over)
        twist, motor, output, position = self.state
        on_motor = self._transmission.on_motor
        np.copyto(self.position, np.where(on_motor, position + twist, position))
        np.copyto(self.velocity, np.where(on_motor, motor, output))

    def _substep(self, torque: Floats, over: HeldTwo) -> None:
        """Move over one substep."""
        twist, motor, output, position = self.state
        _, _, coulomb, _, stiffness, damping = self._parameters
        frictional = coulomb > 0.0
        drive = torque - (stiffness * twist + damping * (motor - output))
        still = (motor == 0.0) & (np.abs(drive) <= coulomb) & frictional
        direction = np.where(motor == 0.0, drive, motor)
        push = torque - np.copysign(coulomb, direction)
        slide, stick = over.slide, over.stick
        slid = [row[0] * twist + row[1] * motor + row[2] * output + row[3] * push for row in slide]
        slid[3] = position + slid[3]
        turned = stick[0, 0] * twist + stick[0, 1] * output
        swung = stick[1, 0] * twist + stick[1, 1] * output
        stuck = [turned, 0.0, swung, position + (twist - turned)]
        pull = np.abs(torque - (stiffness * turned - damping * swung))
        ends = np.where(still, pull > coulomb, ~(slid[1] * direction > 0.0)) & frictional
        few = np.flatnonzero(ends)
        before = self.state[:, few]
        for row, one, other in zip(self.state, slid, stuck, strict=True):
            np.copyto(row, np.where(still, other, one))
        if few.size:
            some = self._parameters[:, few]
            self.state[:, few] = through_events(
                some, before, torque[few], over.duration[few] / over.parts
            )


def through_events(parameters: Floats, state: Floats, torque: Floats, duration: Floats) -> Floats:
    """Return the states of some servos after a time in which motors stop or break away.

    Args:
        parameters: Inertia, viscous and Coulomb friction, load, stiffness and damping; (6, n).
        state: As of ``ManyTwoMasses``, shape (4, n).
        torque: Held torque on the motor's side [N·m], shape (n,).
        duration: [s], shape (n,).
    """
    result, left = state.copy(), duration.copy()
    leaves = np.zeros(torque.size, dtype=np.bool_)
    index = np.arange(torque.size)
    for number in range(MOST_EVENTS):
        now, length = result[:, index], left[index]
        some = parameters[:, index]
        _, _, coulomb, _, stiffness, damping = some
        drive = torque[index] - (stiffness * now[0] + damping * (now[1] - now[2]))
        still = (now[1] == 0.0) & (np.abs(drive) <= coulomb) & ~leaves[index]
        side = np.copysign(1.0, np.where(now[1] == 0.0, drive, now[1]))
        push = torque[index] - side * coulomb
        course = _course(some, now, push, still, length)
        end = _at(course, np.ones_like(length))
        pull = torque[index] - (stiffness * end[0] - damping * end[2])
        side = np.where(still, np.copysign(1.0, pull), side)
        # Positive while the motion lasts: the speed along its direction, the friction left at rest.
        value = [
            np.where(
                still,
                side * (stiffness * twist - damping * output),
                side * motor,
            )
            for twist, motor, output, _ in course
        ]
        value[0] = value[0] + np.where(still, coulomb - side * torque[index], 0.0)
        share, ended = _first(value)
        if number == MOST_EVENTS - 1:
            share, ended = np.ones_like(share), np.zeros_like(ended)
        after = _at(course, share)
        after[1] = np.where(still | ended, 0.0, after[1])
        result[:, index] = after
        left[index] = np.where(ended, length - share * length, 0.0)
        leaves[index] = still & ended
        index = index[left[index] > 0.0]
        if not index.size:
            break
    return result


def _responses(cases: Floats) -> tuple[Floats, Floats]:
    """Return the responses of ``HeldTwo`` of servos with these parameters and lengths, (7, n)."""
    from scipy.linalg import expm

    inertia, viscous, _, load, stiffness, damping, length = cases
    rates = np.zeros((cases.shape[1], 5, 5))
    rates[:, 0, 1], rates[:, 0, 2] = 1.0, -1.0
    rates[:, 1, 0], rates[:, 1, 1] = -stiffness / inertia, -(damping + viscous) / inertia
    rates[:, 1, 2], rates[:, 1, 4] = damping / inertia, 1.0 / inertia
    rates[:, 2, 0], rates[:, 2, 1], rates[:, 2, 2] = (
        stiffness / load,
        damping / load,
        -damping / load,
    )
    rates[:, 3, 2] = 1.0
    slide = expm(rates * length[:, None, None])[:, :4, [0, 1, 2, 4]]
    at_rest = rates[:, [[0], [2]], [0, 2]]
    stick = expm(at_rest * length[:, None, None])
    return np.moveaxis(slide, 0, -1), np.moveaxis(stick, 0, -1)


def _course(
    parameters: Floats, state: Floats, push: Floats, still: Bools, length: Floats
) -> list[Floats]:
    """Return the motion as powers of the share of ``length`` that has passed, each (4, n)."""
    inertia, viscous, _, load, stiffness, damping = parameters
    twist, motor, output, _ = state
    terms, factor, constant = [state], length, push
    for k in range(2, TERMS):
        spring = stiffness * twist + damping * (motor - output)
        twist, motor, output, way = (
            factor * (motor - output),
            np.where(still, 0.0, factor * ((constant - spring - viscous * motor) / inertia)),
            factor * (spring / load),
            factor * output,
        )
        constant = 0.0 * push
        terms.append(np.array([twist, motor, output, way]))
        if np.abs(terms[-1]).max() < SMALL:
            break
        factor = length / k
    return terms


def _at(course: Sequence[Floats], share: Floats) -> Floats:
    """Return the value of a series at a share of its length."""
    value = np.zeros_like(course[0])
    for term in reversed(course):
        value = value * share + term
    return value


def _first(value: Sequence[Floats]) -> tuple[Floats, Bools]:
    """Return where a positive value first falls to 0 or below, as a share, and whether it does.

    One that is nowhere positive, at the looks, ends at the first look.
    """
    low, high = np.zeros_like(value[0]), np.zeros_like(value[0])
    was, ended = value[0] > 0.0, np.zeros(value[0].shape, dtype=np.bool_)
    ever = was.copy()
    for k in range(1, LOOKS + 1):
        positive = _at(value, np.full_like(low, k / LOOKS)) > 0.0
        falls = was & ~positive & ~ended
        low[falls], high[falls] = (k - 1) / LOOKS, k / LOOKS
        ended |= falls
        was, ever = positive, ever | positive
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        positive = _at(value, middle) > 0.0
        low, high = np.where(positive, middle, low), np.where(positive, high, middle)
    never = ~ever
    share = np.where(ended, high, np.where(never, 1.0 / LOOKS, 1.0))
    return share, ended | never
