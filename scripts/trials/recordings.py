"""Tries ``detect`` on recordings of walls above their limit, with more or less known values.

The walls have no damping and 1.3 to 2.2 times the stiffness that is stable for their kick. A
recording has the columns of a CSV: times, counted positions, commanded torques.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.detector.detection import detect
from haptic_wall.controller.detector.oscillation import DetectorSettings
from haptic_wall.controller.detector.servo_fit import fitted_servo
from haptic_wall.controller.detector.wall_fit import fitted_wall
from haptic_wall.controller.logs.detected import with_fit
from scripts.study import Given
from scripts.trials.detector_trials import NAMES, above_limit
from scripts.trials.listening import COUNT, PERIOD
from scripts.trials.rates import most
from scripts.trials.sections import Job, Made, draws, in_parts, section, walls_of
from scripts.trials.watched import kicked

SHARES = 1.3, 2.2
"""Range of K over the limit for the kick [1]"""
GIVEN = "servo and delay", "delay", "nothing"
"""Known values of the servo and its loop"""
_CYCLES, _UNTIL = 60.0, 3.0
_FEW = 10.0 * COUNT
"""Amplitude up to which an alarm is early for any kick [rad]"""
_A_JOB = 50


@dataclass(frozen=True, slots=True)
class Recorded:
    """The detector's result on one recording."""

    name: str
    """Name of the servo"""
    seen: tuple[bool, ...]
    """There was an alarm, for each of ``GIVEN``"""
    early: tuple[bool, ...]
    """It came before the amplitude was twice the kick, or 10 counts"""


def recorded(job: tuple[int, tuple[int, ...]]) -> list[Recorded]:
    """Draw walls, kick each, and run the detector over the recordings.

    Args:
        job: Number of walls, and the seed.
    """
    count, seed = job
    random = draws(seed)
    drawn = above_limit(count, SHARES, random)
    walls = drawn.walls
    found = []
    for i, trace in enumerate(kicked(walls, drawn.kick, _CYCLES, until=_UNTIL)):
        reached = np.maximum.accumulate(np.abs(trace.position))
        if reached[-1] < 2.0 * drawn.kick[i]:
            continue  # saturated, or too slow for a result
        positions = np.asarray(trace.counts * COUNT, dtype=np.float64)
        times = np.asarray(np.arange(positions.size) * PERIOD, dtype=np.float64)
        m, b, c, delay = drawn.belief[i].tolist()
        servo = {
            "inertia": float(walls.inertia[i]) * m,
            "damping": float(walls.damping[i]) * b,
            "coulomb": float(walls.coulomb[i]) * c,
            "lag": float(walls.whole[i] * PERIOD + walls.lag[i]) * delay,
        }
        wall = fitted_wall(positions, trace.torque, PERIOD)
        fit = fitted_servo(positions, trace.torque, PERIOD)
        nothing = dict.fromkeys(("inertia", "damping", "coulomb", "lag"), math.nan)
        at = []
        for told in (servo, {**nothing, "lag": servo["lag"]}, nothing):
            known = with_fit(told, fit)
            settings = DetectorSettings(
                PERIOD, known["inertia"], known["damping"], known["coulomb"]
            )
            late = known["lag"]
            record = detect(times, positions, trace.torque, settings, lag=late, wall=wall)
            at.append(record.first_alarm_s)
        enough = max(2.0 * float(drawn.kick[i]), _FEW)
        found.append(
            Recorded(
                NAMES[drawn.who[i]],
                tuple(not math.isnan(s) for s in at),
                tuple(not math.isnan(s) and bool(reached[round(s / PERIOD)] < enough) for s in at),
            )
        )
    return found


def jobs(given: Given) -> list[Job]:
    """Return the jobs: all walls, in parts."""
    parts = in_parts(walls_of(given, 20), _A_JOB)
    return [(count, (given.seed, 6, part)) for part, count in parts]


def told(results: list[list[Recorded]]) -> Made:
    """Return the section's text."""
    every = [one for some in results for one in some]
    lines = [
        f"Two-sided walls with B = 0 and {SHARES[0]} to {SHARES[1]} times the K that is stable for"
        " their kick, recorded as a CSV: times, counted positions, commanded torques. The detector"
        " estimates the wall from torque against position. The study gives it the servo and its"
        " delay, each value at most a fifth wrong; or only the delay; or nothing. An alarm is"
        " early if it comes before the amplitude was twice the kick, or 10 counts.",
        "",
        f"| servo | recordings | {' | '.join(f'{g}: alarm | early' for g in GIVEN)} |",
        f"|---|---|{'---|---|' * len(GIVEN)}",
    ]
    for name in (*NAMES, "all"):
        some = [one for one in every if name in (one.name, "all")]
        n = len(some)
        if n:
            cells = [
                most(sum(which[place] for which in whole), n)
                for place in range(len(GIVEN))
                for whole in ([one.seen for one in some], [one.early for one in some])
            ]
            lines.append(f"| {name} | {n} | {' | '.join(cells)} |")
    return Made(lines, [])


RECORDINGS = section("recordings", jobs, recorded, told, case_s=48.0)
