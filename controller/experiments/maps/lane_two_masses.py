"""Moves servos with a load in lanes; as ``haptic_wall.hw.plant.many_two_masses``."""

from __future__ import annotations

import math

from haptic_wall.controller.experiments.maps.lane_rows import (
    ACTING,
    COULOMB,
    FLAG,
    INERTIA,
    LANES,
    LOAD,
    LOSS,
    MOTOR,
    ON_MOTOR,
    OUTPUT,
    PLACE,
    POSITION,
    RESPONSE,
    RESPONSES,
    SPRING,
    TWIST,
    VELOCITY,
    VISCOUS,
)
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.plant.many_two_masses import HALVINGS, LOOKS, MOST_EVENTS, SMALL, TERMS


def swing(w: FloatArray, loads: FloatArray, terms: FloatArray, part: int, parts: int) -> None:
    """Move two masses over the substeps of a part of a period.

    Args:
        w: The workspace.
        loads: That of two masses.
        terms: Room for a power series, shape (5, TERMS).
        part: 0 before the torque changes, 1 after it.
        parts: Number of substeps.
    """
    at = (RESPONSES + part * RESPONSE) * LANES
    for _ in range(parts):
        few = 0
        for i in range(LANES):
            twist, motor = loads[TWIST * LANES + i], loads[MOTOR * LANES + i]
            output, place = loads[OUTPUT * LANES + i], loads[PLACE * LANES + i]
            spring, loss = loads[SPRING * LANES + i], loads[LOSS * LANES + i]
            torque, coulomb = w[ACTING * LANES + i], w[COULOMB * LANES + i]
            frictional = coulomb > 0.0
            pull = torque - (spring * twist + loss * (motor - output))
            still = (motor == 0.0) & (abs(pull) <= coulomb) & frictional
            direction = pull if motor == 0.0 else motor
            push = torque - math.copysign(coulomb, direction)
            j = at + i
            a = loads[j] * twist + loads[j + LANES] * motor
            a = a + loads[j + 2 * LANES] * output + loads[j + 3 * LANES] * push
            b = loads[j + 4 * LANES] * twist + loads[j + 5 * LANES] * motor
            b = b + loads[j + 6 * LANES] * output + loads[j + 7 * LANES] * push
            c = loads[j + 8 * LANES] * twist + loads[j + 9 * LANES] * motor
            c = c + loads[j + 10 * LANES] * output + loads[j + 11 * LANES] * push
            d = loads[j + 12 * LANES] * twist + loads[j + 13 * LANES] * motor
            d = d + loads[j + 14 * LANES] * output + loads[j + 15 * LANES] * push
            turned = loads[j + 16 * LANES] * twist + loads[j + 17 * LANES] * output
            swung = loads[j + 18 * LANES] * twist + loads[j + 19 * LANES] * output
            leaves = abs(torque - (spring * turned - loss * swung)) > coulomb
            stops = not (b * direction > 0.0)
            ends = frictional & (leaves if still else stops)
            few += 1 if ends else 0
            w[FLAG * LANES + i] = 1.0 if ends else 0.0
            after = turned if still else a
            loads[TWIST * LANES + i] = twist if ends else after
            after = 0.0 if still else b
            loads[MOTOR * LANES + i] = motor if ends else after
            after = swung if still else c
            loads[OUTPUT * LANES + i] = output if ends else after
            after = place + (twist - turned) if still else place + d
            loads[PLACE * LANES + i] = place if ends else after
        for i in range(LANES if few else 0):
            if w[FLAG * LANES + i] != 0.0:
                through_events(w, loads, terms, i, loads[at + 20 * LANES + i])
    for i in range(LANES):
        on_motor = loads[ON_MOTOR * LANES + i] != 0.0
        place, twist = loads[PLACE * LANES + i], loads[TWIST * LANES + i]
        w[POSITION * LANES + i] = place + twist if on_motor else place
        motor, output = loads[MOTOR * LANES + i], loads[OUTPUT * LANES + i]
        w[VELOCITY * LANES + i] = motor if on_motor else output


def through_events(
    w: FloatArray, loads: FloatArray, terms: FloatArray, i: int, length: float
) -> None:
    """Move the servo in lane ``i`` over a time [s] in which its motor stops or breaks away."""
    torque, coulomb = w[ACTING * LANES + i], w[COULOMB * LANES + i]
    spring, loss = loads[SPRING * LANES + i], loads[LOSS * LANES + i]
    leaves = False
    for number in range(MOST_EVENTS):
        twist, motor = loads[TWIST * LANES + i], loads[MOTOR * LANES + i]
        output = loads[OUTPUT * LANES + i]
        pull = torque - (spring * twist + loss * (motor - output))
        still = motor == 0.0 and abs(pull) <= coulomb and not leaves
        side = math.copysign(1.0, pull if motor == 0.0 else motor)
        count = course(w, loads, terms, i, torque - side * coulomb, still, length)
        if still:
            end, swung = series(terms, 1, count, 1.0), series(terms, 3, count, 1.0)
            side = math.copysign(1.0, torque - (spring * end - loss * swung))
        for k in range(count):
            held = side * (spring * terms[1, k] - loss * terms[3, k])
            terms[0, k] = held if still else side * terms[2, k]
        terms[0, 0] = terms[0, 0] + (coulomb - side * torque if still else 0.0)
        share, ended = first(terms, count)
        if number == MOST_EVENTS - 1:
            share, ended = 1.0, False
        loads[TWIST * LANES + i] = series(terms, 1, count, share)
        motor = series(terms, 2, count, share)
        loads[MOTOR * LANES + i] = 0.0 if still or ended else motor
        loads[OUTPUT * LANES + i] = series(terms, 3, count, share)
        loads[PLACE * LANES + i] = series(terms, 4, count, share)
        leaves = still and ended
        length = length - share * length if ended else 0.0
        if not length > 0.0:
            return


def course(
    w: FloatArray,
    loads: FloatArray,
    terms: FloatArray,
    i: int,
    push: float,
    still: bool,
    length: float,
) -> int:
    """Put the motion as powers of the share of ``length`` [s] into ``terms``; return their number.

    Rows 1 to 4 are twist, speeds of motor and output, and position of the output.
    """
    spring, loss = loads[SPRING * LANES + i], loads[LOSS * LANES + i]
    inertia, load = w[INERTIA * LANES + i], loads[LOAD * LANES + i]
    viscous = loads[VISCOUS * LANES + i]
    twist, motor = loads[TWIST * LANES + i], loads[MOTOR * LANES + i]
    output, way = loads[OUTPUT * LANES + i], loads[PLACE * LANES + i]
    terms[1, 0], terms[2, 0], terms[3, 0], terms[4, 0] = twist, motor, output, way
    factor, constant, count = length, push, 1
    for k in range(2, TERMS):
        passed = spring * twist + loss * (motor - output)
        gain = 0.0 if still else factor * ((constant - passed - viscous * motor) / inertia)
        twist, way = factor * (motor - output), factor * output
        output, motor = factor * (passed / load), gain
        constant = 0.0
        terms[1, count], terms[2, count] = twist, motor
        terms[3, count], terms[4, count] = output, way
        count += 1
        if max(abs(twist), abs(motor), abs(output), abs(way)) < SMALL:
            break
        factor = length / k
    return count


def series(terms: FloatArray, row: int, count: int, share: float) -> float:
    """Return the value of a series at a share of its length."""
    value = 0.0
    for k in range(count - 1, -1, -1):
        value = value * share + terms[row, k]
    return value


def first(terms: FloatArray, count: int) -> tuple[float, bool]:
    """Return where the value in row 0 first falls to 0 or below, as a share, and whether it does.

    One that is nowhere positive, at the looks, ends at the first look.
    """
    was = terms[0, 0] > 0.0
    ever, low, high = was, 0.0, 0.0
    for k in range(1, LOOKS + 1):
        positive = series(terms, 0, count, k / LOOKS) > 0.0
        if was and not positive:
            low, high = (k - 1) / LOOKS, k / LOOKS
            break
        was = positive
        ever = ever or positive
    if high == 0.0:
        return (1.0, False) if ever else (1.0 / LOOKS, True)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if series(terms, 0, count, middle) > 0.0:
            low = middle
        else:
            high = middle
    return high, True
