"""Evaluates one trial from the rows of a run: start, growth and sample age."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.experiments.sweep.decrement import Growth, growth, turning_points
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.experiments.sweep.growth_fit import Trial
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.hw.servo import Outcome

_DISTURBED, _HOPELESS = 0.03, 0.2
"""Largest fraction of lost, late or skipped periods, or of saturated ones, in a half-cycle; where
most have more, the better half is used up to the second value"""
_NOISE_COUNTS = 2.5
_NOISE_SHARE = 0.002
"""Smallest half-cycle above noise: in counts; in kicks, without an encoder a tenth of that"""
_FIRST_CYCLES = 6
"""Number of half-cycles whose mean decides whether a motion grows"""


@dataclass(frozen=True, slots=True)
class Seen:
    """The result of one trial."""

    trial: Trial
    start: float
    """Position at the release, from the program's start [rad]"""
    age: float | None
    """Age of the sample behind the torque, averaged over the used half-cycles [s]; None: none"""
    disturbed: bool
    """Bus or machine lost so much of it that neither growth nor decay can be told"""


def watch(
    rows: NDArray[np.void], number: int, phase: Phase, device: Device, kick: float
) -> Seen | None:
    """Evaluate the motion of a trial.

    Args:
        rows: Rows of the whole run.
        number: Number of the trial's phase.
        phase: That phase.
        device: The belief; its period and encoder step are used.
        kick: [rad]

    Returns:
        None where the phase has hardly begun.
    """
    numbers: IntArray = rows["phase"]
    here = numbers == number
    own = rows[here]
    if own.size < 3:
        return None
    position = own["position"] - float(rows["position"][0])
    time = (own["sampled_ns"] - own["sampled_ns"][0]) * 1e-9
    good = own["outcome"] == Outcome.OK
    step = device.position_step
    least = _NOISE_SHARE * kick * (1.0 if step else 0.1)
    turns = turning_points(time[good], position[good], max(_NOISE_COUNTS * step, least))
    sound = _sound(own, phase, position, time, turns.time, device.period)
    found = growth(turns, sound)
    age = None
    if sound.any():
        used = sound[np.clip(np.searchsorted(turns.time, time) - 1, 0, sound.size - 1)]
        age = _mean_age(own, used, device.period) if used.any() else None
    trial = Trial(phase.stiffness, found, turns.half_period, _grew(found, turns.position, position))
    lost = float(np.sum(own["missed"]) + np.sum(~good)) > _DISTURBED * own.size
    if not found.log_ratio.size and not lost:  # a few losses may have spoiled every half-cycle
        limited = (own, phase, position, time, turns.time, device.period)
        lost = bool(growth(turns, _sound(*limited, losses=False)).log_ratio.size)
    return Seen(trial, float(position[0]), age, lost and not found.log_ratio.size)


def _sound(
    own: NDArray[np.void],
    phase: Phase,
    position: FloatArray,
    time: FloatArray,
    turned: FloatArray,
    period: float,
    losses: bool = True,
) -> NDArray[np.bool_]:
    """Whether each half-cycle is undisturbed: no saturation; no loss and no stall, if asked."""
    torque: FloatArray = own["wall_torque"]
    missed: IntArray = own["missed"]
    failed: NDArray[np.bool_] = own["outcome"] != Outcome.OK
    asked = -phase.stiffness * position - phase.damping * own["velocity"]
    # A torque that differs from spring and damper was limited.
    cut = np.abs(asked - torque) > 1e-9 * (1.0 + np.abs(asked))
    wrong = missed + cut + failed if losses else cut & ~failed
    total = np.concatenate([[0.0], np.cumsum(wrong)])
    at = np.clip(np.searchsorted(time, turned), 0, own.size)
    share = np.diff(total[at]) / np.maximum(np.diff(turned) / period, 1.0)
    usual = float(np.median(share)) if share.size else 0.0
    result: NDArray[np.bool_] = share <= min(max(usual, _DISTURBED), _HOPELESS)
    return result


def _mean_age(own: NDArray[np.void], used: NDArray[np.bool_], period: float) -> float:
    """Return the age of the sample behind the torque, averaged over time [s].

    A lost sample leaves an older one in force, a skipped period an older torque.
    """
    missed: IntArray = own["missed"][1:]
    age: FloatArray = own["age_ns"] * 1e-9
    held = np.append(1.0 + missed, 1.0) * used
    stale = age + 0.5 * period * (held - 1.0)
    return float(np.sum(held * stale) / np.sum(held))


def _grew(found: Growth, turned: FloatArray, position: FloatArray) -> bool:
    """Whether the motion grew, as far as can be decided."""
    if found.log_ratio.size:
        return bool(np.mean(found.log_ratio[:_FIRST_CYCLES]) > 0.0)
    if turned.size > 2:
        return abs(float(turned[-1])) > abs(float(turned[1]))
    return bool(np.max(np.abs(position)) > 1.2 * abs(float(position[0])))
