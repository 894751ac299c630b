"""Measures the torque that moves a servo without a wall, at several constant speeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.experiments.holding import Hold
from haptic_wall.controller.experiments.steps.step_fit import StepFit
from haptic_wall.controller.experiments.steps.torque_steps import good
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.theory.checks import FloatArray, IntArray

REACH = 0.4
"""Travel to either side [rad]."""
_SPEEDS = (0.5, 1.0, 1.75, 2.5)
"""Wanted speeds [rad/s]"""
_SPEED_SHARE = 0.3
"""Largest fraction of ``safety.max_speed``"""
_REPEATS = (1.0, 0.91, 1.06)
"""Factors on the speed: repeats at equal speed would have equal errors by the encoder's counts"""
_MIDDLE = (0.35, 0.95)
"""Part of each way that is used: after the acceleration, before the end"""
_FEWEST = 20
"""Least number of samples of a usable way"""


@dataclass(frozen=True, slots=True)
class Drag:
    """Resistance of the servo; torques are commanded ones."""

    coulomb: float
    """[N·m]"""
    coulomb_stderr: float
    viscous: float
    """[N·m·s/rad]"""
    viscous_stderr: float
    speed: FloatArray
    """Mean of each way, signed [rad/s]"""
    torque: FloatArray
    """Torque that it took [N·m]"""


def drag_phases(hold: Hold, max_speed: float) -> list[Phase]:
    """Return the program: to and fro at several speeds."""
    fastest = _SPEED_SHARE * max_speed
    speeds = [min(speed, fastest * speed / _SPEEDS[-1]) for speed in _SPEEDS]
    phases = [hold.phase(2.0, -REACH, still_s=0.1)]
    for share in _REPEATS:
        for speed in (share * speed for speed in speeds):
            for end in (REACH, -REACH):
                # The centre waits at the end for the shaft, which lags behind it.
                phases.append(hold.phase(2.0 * REACH / speed + 0.15, end, speed))
    phases.append(hold.phase(2.0, still_s=0.1))
    return phases


def drag(rows: NDArray[np.void], phases: Sequence[Phase], fit: StepFit) -> Drag | None:
    """Return Coulomb and viscous friction from the torque of each way.

    Args:
        rows: Rows of the log, dtype ``telemetry.ROW``.
        phases: Phases of the program.
        fit: Gives the lag of a torque, and its part for acceleration.

    Returns:
        None where the shaft did not move both ways at two speeds.
    """
    # Torques were sent in all periods, also in those with a lost sample.
    sampled: IntArray = rows["sampled_ns"]
    age: IntArray = rows["age_ns"]
    acts, sent = (sampled + age) * 1e-9 + fit.lag, rows["torque"]
    rows = good(rows)
    time = rows["sampled_ns"] * 1e-9
    number = rows["phase"]
    speeds, torques, lasts = [], [], []
    for place, (before, phase) in enumerate(pairwise(phases)):
        if phase.still_s is not None or phase.speed is None:
            continue
        index = np.flatnonzero(number == place + 1)
        travels = abs(phase.center - before.center) / phase.speed
        since = time[index] - time[index[0]]
        index = index[(since > _MIDDLE[0] * travels) & (since < _MIDDLE[1] * travels)]
        if index.size < _FEWEST:
            continue
        at, x = time[index] - time[index[0]], rows["position"][index]
        pushed = _twice_integrated(acts - time[index[0]], sent, at)
        # The part without effect on the motion: half of it grows with the square of time.
        curve = np.linalg.lstsq(np.vander(at, 3), pushed - x / fit.acceleration, rcond=None)[0]
        lasts.append(float(at[-1]))
        torques.append(2.0 * float(curve[0]))
        speeds.append(float(np.linalg.lstsq(np.vander(at, 2), x, rcond=None)[0][0]))
    speed, torque = np.array(speeds), np.array(torques)
    if np.unique(np.round(speed, 1)).size < 4:
        return None
    columns = np.stack([np.sign(speed), speed, np.ones_like(speed)], axis=1)
    # Uncertainty of the curvature by the encoder's rounding.
    weight = np.array(lasts)[:, None] ** 2.5
    columns = columns * weight
    values = np.linalg.lstsq(columns, torque * weight[:, 0], rcond=None)[0]
    rest = torque * weight[:, 0] - columns @ values
    variance = float(rest @ rest) / max(speed.size - 3, 1)
    errors = np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)) * variance)
    return Drag(
        float(values[0]), float(errors[0]), float(values[1]), float(errors[1]), speed, torque
    )


def _twice_integrated(acts: FloatArray, torque: FloatArray, at: FloatArray) -> FloatArray:
    """Return the double integral of a held torque [N·m·s²], from the first requested instant.

    Args:
        acts: When each torque begins to act [s].
        torque: [N·m].
        at: Requested instants [s].
    """
    held = np.diff(acts)
    once = np.concatenate([[0.0], np.cumsum(torque[:-1] * held)])
    twice = np.concatenate([[0.0], np.cumsum((once[:-1] + 0.5 * torque[:-1] * held) * held)])
    place = np.clip(np.searchsorted(acts, at, side="right") - 1, 0, acts.size - 1)
    past = at - acts[place]
    whole = twice[place] + (once[place] + 0.5 * torque[place] * past) * past
    found: FloatArray = whole - whole[0]
    return found
