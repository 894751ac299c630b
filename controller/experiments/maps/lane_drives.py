"""Computes torques of current loops in lanes; as ``haptic_wall.hw.plant.current_loops``."""

from __future__ import annotations

import math

from haptic_wall.controller.experiments.maps.lane_rows import (
    ACTING,
    BACK_EMF,
    DEAD,
    GOAL,
    LANES,
    LOST,
    MOTOR,
    PACE,
    SHARES,
    STALL,
    VELOCITY,
    VOLTAGE,
)
from haptic_wall.controller.theory.checks import FloatArray


def aim(w: FloatArray, drives: FloatArray) -> None:
    """Take the acting torques as goals."""
    for i in range(LANES):
        drives[GOAL * LANES + i] = w[ACTING * LANES + i]


def drive(w: FloatArray, drives: FloatArray, loads: FloatArray, part: int) -> None:
    """Compute the torques to hold over the next step.

    Args:
        w: The workspace.
        drives: That of the current loops.
        loads: That of two masses; empty: the servos are rigid.
        part: 0 before the torque changes, 1 after it.
    """
    share = (SHARES + 2 * part) * LANES
    flexible = loads.shape[0] > 0
    for i in range(LANES):
        velocity = loads[MOTOR * LANES + i] if flexible else w[VELOCITY * LANES + i]
        back, stall = drives[BACK_EMF * LANES + i], drives[STALL * LANES + i]
        middle = velocity + 0.5 * (velocity - drives[PACE * LANES + i])
        drives[PACE * LANES + i] = velocity
        back_emf = back * middle
        goal = drives[GOAL * LANES + i]
        beyond = abs(goal) - drives[DEAD * LANES + i]
        wanted = math.copysign(beyond if beyond > 0.0 else 0.0, goal)
        wanted = wanted + (back_emf - drives[LOST * LANES + i] * abs(middle) * middle)
        limited = -stall if wanted < -stall else wanted
        limited = stall if limited > stall else limited
        target = limited if back > 0.0 else wanted
        mean, rest = drives[share + i], drives[share + LANES + i]
        gap = drives[VOLTAGE * LANES + i] - target if rest < 1.0 else 0.0
        drives[VOLTAGE * LANES + i] = target + gap * rest
        w[ACTING * LANES + i] = target + gap * mean - back_emf
