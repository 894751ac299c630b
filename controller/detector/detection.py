"""Runs the detector over a record: computes its result at every sample."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptic_wall.controller.detector.acting import ActingTorque
from haptic_wall.controller.detector.backstop_settings import BackstopSettings, sizes
from haptic_wall.controller.detector.oscillation import Detector, DetectorSettings, State
from haptic_wall.controller.detector.own_motion import OwnMotion
from haptic_wall.controller.detector.tuning import TUNING, RecordingTuning

Array = NDArray[np.float64]

_ROUNDING = 1e-9
"""Steps that are smaller than this fraction of the largest are rounding errors [1]"""


@dataclass(frozen=True, slots=True)
class DetectionRecord:
    """The detector's results at every sample; arrays of one length."""

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
    """The worst state"""
    worst_at: int
    """Sample of the largest amplitude in that state"""
    first_alarm_s: float
    """Time of the first alarm, on the record's own clock [s]; NaN: none"""

    @classmethod
    def of(
        cls,
        times: Array,
        state: NDArray[np.int8],
        frequency_hz: Array,
        amplitude: Array,
        growth: Array,
        alarm: NDArray[np.bool_],
    ) -> DetectionRecord:
        """Return the record, with the worst state and the first alarm found in the samples.

        Args:
            times: Times of the samples [s], shape (n,).
            state: As the field of this name, shape (n,).
            frequency_hz: [Hz]
            amplitude: [rad]
            growth: [1/s]
            alarm: Shape (n,).
        """
        worst = State(int(state.max())) if state.size else State.QUIET
        largest = int(np.argmax(np.where(state == worst, amplitude, -1.0))) if state.size else 0
        first = float(times[np.argmax(alarm)]) if alarm.any() else math.nan
        return cls(state, frequency_hz, amplitude, growth, alarm, worst, largest, first)


@dataclass(frozen=True, slots=True)
class KnownWall:
    """Known parameters of the rendered wall; NaN: not known."""

    stiffness: ArrayLike = math.nan
    """Commanded K, one value or one a sample [N·m/rad]"""
    virtual_damping: float = 0.0
    """Commanded B [N·m·s/rad]"""
    surface: float = math.nan
    """Position of its surface [rad]"""
    side: int = 0
    """0: two-sided; +1 or -1: it fills the positions above or below, and never pulls"""
    inserted: float = 0.0
    """Inserted delay, from a sample to commanding its torque [s]"""


def detect(
    times: Array,
    positions: Array,
    torques: Array | None,
    settings: DetectorSettings,
    *,
    lag: float = 0.0,
    stiffness: ArrayLike = math.nan,
    wall: KnownWall | None = None,
) -> DetectionRecord:
    """Run the detector over a record.

    Args:
        times: Times of the samples, increasing, shape (n,) [s]. Missing samples count as skipped
            periods; after a gap of more than 50 ms the detector restarts.
        positions: Shape (n,) [rad]; samples with NaN are skipped.
        torques: Commanded with each sample, shape (n,) [N·m]; NaN where not known; None: at none.
        settings: Known values of the servo; its period is the grid's. A missing position step is
            estimated from the record, if it has one.
        lag: Delay from a sample until its torque acts, >= 0 [s].
        stiffness: As in ``wall``, where nothing else is known.
        wall: Known parameters of the wall.

    Raises:
        ValueError: The lengths differ, or times do not increase.
    """
    n = len(times)
    if len(positions) != n or (torques is not None and len(torques) != n):
        raise ValueError(
            f"{n} times, {len(positions)} positions and"
            f" {'no' if torques is None else len(torques)} torques; give one of each for a sample"
        )
    if n > 1 and not np.all(np.diff(times) > 0):
        raise ValueError("times do not increase; give the samples in order of time")
    known = wall or KnownWall(stiffness)
    if math.isnan(settings.position_step):
        settings = replace(
            settings, position_step=position_step(positions, settings.tuning.recording)
        )
    detector = _detector(settings, known, lag)
    own = _own_motion(settings, known.side)
    surface = known.surface if math.isfinite(known.surface) else 0.0
    acting = ActingTorque(lag / settings.period)
    state, alarm = np.zeros(n, dtype=np.int8), np.zeros(n, dtype=np.bool_)
    frequency, growth, amplitude = np.full(n, np.nan), np.full(n, np.nan), np.zeros(n)
    commanded = [math.nan] * n if torques is None else np.asarray(torques, float).tolist()
    stiff = np.broadcast_to(np.asarray(known.stiffness, float), (n,)).tolist()
    when, where = np.asarray(times, float).tolist(), np.asarray(positions, float).tolist()
    last: float | None = None
    for k in range(n):
        if math.isfinite(where[k]):
            gap = 0.0 if last is None else when[k] - last
            periods = max(1, round(gap / settings.period))
            last = when[k]
            if gap > max(settings.tuning.recording.gap_s, 2.0 * settings.period):
                detector.restart()
                own.resume()
            detector.stiffness = stiff[k]
            detector.update(where[k], acting.push(commanded[k], periods), periods)
            own.update(where[k] - surface, 0.0, periods * settings.period, math.nan)
        state[k], alarm[k] = detector.state, detector.alarm or own.alarm
        frequency[k], amplitude[k] = detector.frequency_hz, detector.amplitude
        growth[k] = detector.growth
        if (own.alarm or own.steady) and state[k] < State.SUSTAINED:
            # Motion that neither the believed values nor a hand explains.
            state[k] = State.GROWING if own.alarm else State.SUSTAINED
            frequency[k], amplitude[k] = own.frequency_hz, own.amplitude
    return DetectionRecord.of(times, state, frequency, amplitude, growth, alarm)


def _own_motion(settings: DetectorSettings, side: int) -> OwnMotion:
    """Return the watch for motion that no hand explains, for any servo: a record is not probed."""
    step = settings.position_step
    step = step if step > 0.0 else 0.0
    threshold, small = sizes(step, settings.tuning)
    watched = BackstopSettings(
        period=settings.period,
        position_step=step,
        threshold=threshold,
        small=small,
        light=0.0,
        heavy=math.inf,
        heaviest=math.inf,
        rest_torque=0.0,
        torque_limit=math.inf,
        acts=False,
        tuning=settings.tuning,
    )
    return OwnMotion(watched, None, side)


def _detector(settings: DetectorSettings, wall: KnownWall, lag: float) -> Detector:
    detector = Detector(settings)
    balance = detector.balance
    balance.surface, balance.side, balance.lag = wall.surface, wall.side, lag + wall.inserted
    balance.virtual_damping = wall.virtual_damping
    return detector


def position_step(positions: Array, tuning: RecordingTuning = TUNING.recording) -> float:
    """Return the encoder step [rad] if all positions differ by multiples of one step; else 0."""
    steps = np.abs(np.diff(positions[np.isfinite(positions)]))
    steps = steps[steps > _ROUNDING * np.max(steps, initial=0.0)]
    if steps.size < tuning.count_steps:
        return 0.0
    # Files are rounded to some digits, which limits the precision of the smallest difference.
    smallest = float(np.median(steps[steps < 1.5 * steps.min()]))
    counts = steps[steps < 20.0 * smallest] / smallest
    whole = bool(np.mean(np.abs(counts - np.rint(counts)) < 0.1) > 0.99)
    # Without an encoder step the smallest difference is far below most others.
    return smallest if whole and counts.size > 0.5 * steps.size else 0.0
