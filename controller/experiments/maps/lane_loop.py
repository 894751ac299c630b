"""Measures positions and computes torques in lanes; as ``many_walls``."""

from __future__ import annotations

import math

import numpy as np

from haptic_wall.controller.experiments.maps.lane_rows import (
    ACTING,
    COUNTS,
    EARLIER,
    FOLLOWED,
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


def command(w: FloatArray, back: int) -> None:
    """Compute the walls' torques from the measured positions."""
    if back:
        for i in range(LANES):
            measured = w[MEASURED * LANES + i]
            estimate = (measured - w[EARLIER * LANES + i]) / w[OVER * LANES + i]
            torque = w[SOFTNESS * LANES + i] * measured
            w[TORQUE * LANES + i] = torque - w[VIRTUAL * LANES + i] * estimate
    else:
        for i in range(LANES):
            w[TORQUE * LANES + i] = w[SOFTNESS * LANES + i] * w[MEASURED * LANES + i]


def limit(w: FloatArray, traits: IntArray) -> None:
    """Keep one-sided walls from pulling; limit and round all torques."""
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
