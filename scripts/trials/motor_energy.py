"""Would the energy at the motor show earlier that a wall feeds a link's vibration?

The encoder on the output sees the damper take energy from the vibration that the motor feeds. With
the link known exactly, the motor's motion at the vibration's frequency follows from the output's:
it is opposite, ``-J_l / J_m`` times as large. The energy that the torque gives there is compared
with what the transmission and the motor's friction dissipate.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, sosfilt

from haptic_wall.controller.theory.checks import FloatArray
from scripts.trials.links import DAMPING, INERTIA, PERIOD, LinkRun, link_run
from scripts.trials.truth import COUNT

_BAND = (0.75, 1.3)
"""Of frequencies that are kept, over the vibration's"""
_FASTEST = 450.0
_SETTLED, _SPAN, _EVERY = 300, 100, 50
"""Rows that the filter settles in, and of a window, and from one window to the next"""
_WRONG = 1.2
"""Given over dissipated energy that shows feeding: the detector allows an error of 20 %, too"""
_IN_A_ROW = 3
_LEAST = 1.0
"""Least amplitude of a window that counts [counts]"""


class MotorTrial(NamedTuple):
    """One wall, and when each of both ways notices."""

    share: float
    """Virtual damping over the ceiling"""
    largest: float
    """Amplitude of the vibration at most [counts]"""
    last: float
    """In the end, or at the alarm [counts]"""
    alarm_s: float
    """First alarm of the present watch; NaN: none [s]"""
    motor_s: float
    """First time that the energy at the motor shows it; NaN: never [s]"""
    motor_size: float
    """Amplitude then [counts]"""


def motor_trials(case: tuple[int, int, float]) -> list[MotorTrial]:
    """Draw servos with a link of 20 to 200 Hz, run a wall on each, and judge by both ways.

    Args:
        case: Seed, number of servos, and virtual damping over the ceiling.
    """
    seed, count, share = case
    random = np.random.default_rng((77, seed))
    runs = (link_run(random, share, 20.0, 200.0) for _ in range(count))
    return [MotorTrial(share, *run.largest_and_last, run.alarm_s, *noticed(run)) for run in runs]


def noticed(run: LinkRun) -> tuple[float, float]:
    """Return when the energy at the motor shows feeding [s], and the amplitude [counts]; or NaN."""
    rate = math.tau * run.hertz
    over = -run.load / INERTIA  # the motor's motion over the output's
    moving = INERTIA * run.load / (INERTIA + run.load)
    transmission = 2.0 * run.ratio * moving * rate
    band = [_BAND[0] * run.hertz, min(_BAND[1] * run.hertz, _FASTEST)]
    taps = butter(2, band, "band", fs=1.0 / PERIOD, output="sos")
    output = sosfilt(taps, run.position - run.position[0])
    torque = sosfilt(taps, _acting(run.torque, run.delay / PERIOD))
    # differences and means over a period, as if they were at an instant
    turn = rate * PERIOD
    exact = turn / math.sin(turn) * math.tan(0.5 * turn) / (0.5 * turn)
    power = exact * over * torque * np.gradient(output, PERIOD)
    in_a_row = 0
    for end in range(_SPAN + _SETTLED, output.size + 1, _EVERY):
        part = slice(end - _SPAN, end)
        square = float(np.mean(output[part] ** 2))
        dissipated = (transmission * (1.0 - over) ** 2 + DAMPING * over**2) * rate**2 * square
        size = math.sqrt(2.0 * square) / COUNT
        feeds = float(power[part].mean()) > _WRONG * dissipated and size > _LEAST
        in_a_row = in_a_row + 1 if feeds else 0
        if in_a_row == _IN_A_ROW:
            return end * PERIOD, size
    return math.nan, math.nan


def _acting(commanded: FloatArray, late: float) -> FloatArray:
    """Return the torque that acts about each row, of torques that are ``late`` periods late."""
    whole = math.floor(late)
    share = late - whole
    padded = np.concatenate([np.zeros(whole + 2), commanded])[: commanded.size + 2]
    held = (1.0 - share) * padded[1:] + share * padded[:-1]
    found: FloatArray = 0.5 * (held[1:] + held[:-1])
    return found
