"""The detector over a record: what it would have said at every sample."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.acting import ActingTorque
from controller.oscillation import Detector, DetectorSettings, State

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DetectionRecord:
    """What was seen at every sample; arrays of one length."""

    state: NDArray[np.int8]
    """``State`` values"""
    frequency_hz: Array
    """[Hz]; NaN where there is no oscillation"""
    amplitude: Array
    """[rad]; 0 where there is no oscillation"""
    growth: Array
    """[1/s]; NaN where there is no oscillation"""
    alarm: NDArray[np.bool_]
    """Whether the wall feeds a sustained or growing oscillation"""
    worst: State
    """The worst state of all"""
    worst_at: int
    """Sample from which its frequency, amplitude and growth are best taken"""
    first_alarm_s: float
    """Time of the first alarm, on the record's own clock [s]; NaN: none"""


def detect(
    times: Array,
    positions: Array,
    torques: Array | None,
    settings: DetectorSettings,
    *,
    lag: float = 0.0,
    stiffness: float | Array = math.nan,
) -> DetectionRecord:
    """Run the detector over a record.

    Args:
        times: Of the samples, increasing, shape (n,) [s]. Gaps count as periods not seen.
        positions: Shape (n,) [rad]; where NaN the sample is left out.
        torques: Commanded with each sample, shape (n,) [N·m]; None: not recorded.
        settings: What is known of the servo; its period is the grid's.
        lag: From a sample to its torque acting, >= 0 [s].
        stiffness: Commanded K [N·m/rad], one value or shape (n,); NaN: not known.

    Raises:
        ValueError: The lengths differ, or times do not increase.
    """
    n = len(times)
    if len(positions) != n or (torques is not None and len(torques) != n):
        raise ValueError("times, positions and torques have different lengths; give one of each")
    if n > 1 and not np.all(np.diff(times) > 0):
        raise ValueError("times do not increase; give the samples in order of time")
    detector = Detector(settings)
    acting = ActingTorque(lag / settings.period)
    state, alarm = np.zeros(n, dtype=np.int8), np.zeros(n, dtype=np.bool_)
    frequency, growth, amplitude = np.full(n, np.nan), np.full(n, np.nan), np.zeros(n)
    commanded = np.full(n, np.nan) if torques is None else torques
    stiff = np.broadcast_to(np.asarray(stiffness, dtype=np.float64), (n,))
    last: int | None = None
    for k in range(n):
        if not math.isfinite(positions[k]):
            pass
        else:
            gap = 1 if last is None else round((times[k] - times[last]) / settings.period)
            periods = max(1, gap)
            last = k
            detector.stiffness = float(stiff[k])
            torque = acting.push(float(commanded[k]), periods)
            detector.update(float(positions[k]), torque, periods)
        state[k], alarm[k] = detector.state, detector.alarm
        frequency[k], amplitude[k] = detector.frequency_hz, detector.amplitude
        growth[k] = detector.growth
    worst = State(int(state.max())) if n else State.QUIET
    first = np.flatnonzero(alarm)
    return DetectionRecord(
        state,
        frequency,
        amplitude,
        growth,
        alarm,
        worst,
        int(np.argmax(np.where(state == worst, amplitude, -1.0))) if n else 0,
        float(times[first[0]]) if first.size else math.nan,
    )
