"""Measures positions and computes torques in lanes; as ``many_walls``."""

from __future__ import annotations

import math

import numpy as np

from haptic_wall.controller.experiments.maps.lane_rows import (
    ACTING,
    COUNTS,
    EARLIER,
    FOLLOWED,
    IN_CONTACT,
    IS_LIMITED,
    LANES,
    LIMIT,
    MEASURED,
    ONE_SIDED,
    OVER,
    PERIOD,
    PLAY,
    POSITION,
    ROUNDED,
    SAMPLES,
    SOFTNESS,
    STEP,
    STEPPED,
    TORQUE,
    VIRTUAL,
)
from haptic_wall.controller.theory.checks import FloatArray, IntArray


def sense(
    w: FloatArray,
    traits: IntArray,
    measured: FloatArray,
    first: int,
    lanes: int,
    now: int,
    back: int,
    since: int,
) -> None:
    """Measure the positions, and fetch those that were measured ``back`` periods ago."""
    if not traits[PLAY]:
        for i in range(LANES):
            w[FOLLOWED * LANES + i] = w[POSITION * LANES + i]
    if traits[ROUNDED]:
        for i in range(LANES):
            counts = w[COUNTS * LANES + i]
            w[MEASURED * LANES + i] = np.rint(w[FOLLOWED * LANES + i] * counts) / counts
    else:
        for i in range(LANES):
            w[MEASURED * LANES + i] = w[FOLLOWED * LANES + i]
    row, earlier = now % measured.shape[0], (now - back) % measured.shape[0]
    for i in range(lanes):
        measured[row, first + i] = w[MEASURED * LANES + i]
    for i in range(lanes):
        w[EARLIER * LANES + i] = measured[earlier, first + i]
    if now <= traits[SAMPLES] or now == since:
        for i in range(LANES):
            w[OVER * LANES + i] = back * w[PERIOD * LANES + i]


def delayed(
    w: FloatArray,
    delays: IntArray,
    torques: FloatArray,
    hands: FloatArray,
    first: int,
    lanes: int,
    now: int,
    since: int,
    least: int,
    most: int,
) -> None:
    """Fetch the torques commanded each wall's whole periods of delay ago, and the operator's."""
    for each in range(least, most):
        row = now - delays[each, 0]
        row += torques.shape[0] if row < 0 else 0
        start, end = max(delays[each, 1] - first, 0), min(delays[each, 2] - first, lanes)
        for i in range(start, end):
            w[ACTING * LANES + i] = torques[row, first + i]
    if hands.shape[0]:
        row = min(since, hands.shape[0] - 1)
        for i in range(lanes):
            w[ACTING * LANES + i] = w[ACTING * LANES + i] + hands[row, first + i]


def follow_table(w: FloatArray, traits: IntArray, table: FloatArray, back: int) -> None:
    """Compute the torques of a law, from a table of its elongation over position."""
    last = table.shape[1] - 1
    for i in range(LANES):
        measured = w[MEASURED * LANES + i]
        low, high = 0, last
        while high - low > 1:
            middle = (low + high) // 2
            if table[0, middle] <= measured:
                low = middle
            else:
                high = middle
        x, first = table[0, low], table[1, low]
        away = first + (table[1, high] - first) * (measured - x) / (table[0, high] - x)
        away = table[1, 0] if measured <= table[0, 0] else away
        away = table[1, last] if measured >= table[0, last] else away
        torque = w[SOFTNESS * LANES + i] * away
        if back:
            estimate = (measured - w[EARLIER * LANES + i]) / w[OVER * LANES + i]
            torque = torque - w[VIRTUAL * LANES + i] * estimate
        if traits[IN_CONTACT] and (away == 0.0 or away * torque >= 0.0):
            torque = 0.0
        w[TORQUE * LANES + i] = torque


def command(w: FloatArray, traits: IntArray, table: FloatArray, back: int) -> None:
    """Compute the walls' torques, limited and rounded, from the measured positions."""
    if back:
        for i in range(LANES):
            measured = w[MEASURED * LANES + i]
            estimate = (measured - w[EARLIER * LANES + i]) / w[OVER * LANES + i]
            torque = w[SOFTNESS * LANES + i] * measured
            w[TORQUE * LANES + i] = torque - w[VIRTUAL * LANES + i] * estimate
    else:
        for i in range(LANES):
            w[TORQUE * LANES + i] = w[SOFTNESS * LANES + i] * w[MEASURED * LANES + i]
    if table.shape[0]:
        follow_table(w, traits, table, back)
    if traits[ONE_SIDED]:
        for i in range(LANES):
            torque = w[TORQUE * LANES + i]
            torque = 0.0 if torque > 0.0 else torque
            w[TORQUE * LANES + i] = 0.0 if w[MEASURED * LANES + i] <= 0.0 else torque
    if traits[IS_LIMITED]:
        for i in range(LANES):
            torque, limit = w[TORQUE * LANES + i], w[LIMIT * LANES + i]
            torque = -limit if torque < -limit else torque
            w[TORQUE * LANES + i] = limit if torque > limit else torque
    if traits[STEPPED]:
        for i in range(LANES):
            step = w[STEP * LANES + i]
            steps = np.rint(w[TORQUE * LANES + i] / step)
            fewer = steps - math.copysign(1.0, steps)
            beyond = abs(steps * step) > w[LIMIT * LANES + i]
            w[TORQUE * LANES + i] = (fewer if beyond else steps) * step
