"""Judges a whole record by its oscillations: computes the result at every sample."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptic_wall.controller.detector.acting import ActingTorque
from haptic_wall.controller.detector.backstop_settings import BackstopSettings, sizes
from haptic_wall.controller.detector.envelope import Piece, pieces
from haptic_wall.controller.detector.oscillation import Detector, DetectorSettings, State
from haptic_wall.controller.detector.own_motion import OwnMotion
from haptic_wall.controller.detector.tuning import TUNING, RecordingTuning

Array = NDArray[np.float64]

BORDER: Final = 0.01
"""Growth of the amplitude's logarithm in a cycle from which it is growth [1]"""
_NEAR: Final = 0.25
"""Part of an oscillation's time before and after it that belongs to the same motion"""
_WHOLE: Final = 0.7
"""So much of a record is the whole of it"""
_MANY: Final = 10.0
"""Cycles that no hand makes so evenly"""
_UNKNOWN: Final = 8.5
"""The same where a record has no torque and nothing else"""
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
    """Judge a whole record by its oscillations; see ``pieces``.

    Args:
        times: Times of the samples, increasing, shape (n,) [s]. After a gap of more than 50 ms the
            motion is judged anew; shorter ones are interpolated.
        positions: Shape (n,) [rad]; samples with NaN are skipped.
        torques: Commanded with each sample, shape (n,) [N·m]; NaN where not known; None: those of
            the wall, if its stiffness is known.
        settings: Known values of the servo; its period is the grid's. A missing position step is
            estimated from the record, if it has one.
        lag: Delay from a sample until its torque acts, >= 0 [s]; NaN: not known.
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
    tuning, period, step = settings.tuning, settings.period, settings.position_step
    if math.isnan(step):
        step = position_step(positions, tuning.recording)
    settings = replace(settings, position_step=step)
    known = wall or KnownWall(stiffness)
    stiff = np.broadcast_to(np.asarray(known.stiffness, float), (n,))
    state, frequency, amplitude, alarm = _ticked(
        times, positions, torques, settings, known, stiff, 0.0 if math.isnan(lag) else lag
    )
    judged = np.zeros(n, dtype=np.bool_)
    found = []
    growth = np.full(n, np.nan)
    for some, ticks, x, u in _stretches(times, positions, torques, settings):
        away = [np.abs(x - end) > 1.5 * step for end in (x[0], x[-1])]
        moving = x.size - int(np.argmax(away[0])) - int(np.argmax(away[1][::-1]))
        for piece in pieces(x, u, period, step):
            pull = piece.pull if u is not None else _rendered(piece, known, stiff[some[0]])
            verdict = _judged(piece, moving, settings, step, pull, lag)
            inside = _note_growth(growth, piece, some, ticks)
            if verdict or piece.growth < BORDER:
                judged[some[_near(piece, ticks)]] = True
            if verdict:
                since = times[inside] - times[some[0]]
                since -= 0.5 * (piece.start + piece.end - 1) * period
                found.append(
                    (piece, verdict, inside, piece.amplitude * np.exp(piece.rate.real * since))
                )
    # The envelope decides on all of a motion that it has judged.
    edges = np.flatnonzero(np.diff(state > State.QUIET)) + 1
    for some in np.split(np.arange(n), edges):
        if judged[some].any():
            state[some], alarm[some], amplitude[some] = State.QUIET, False, 0.0
            frequency[some] = np.nan
    for piece, verdict, inside, size in found:
        state[inside], amplitude[inside] = verdict, size
        frequency[inside] = piece.rate.imag / math.tau
        large = size >= tuning.belief.alarm_counts * step
        alarm[inside] = large & (verdict >= State.SUSTAINED)
    growth[state == State.QUIET] = np.nan
    return DetectionRecord.of(times, state, frequency, amplitude, growth, alarm)


def growths(
    times: Array, positions: Array, torques: Array | None, settings: DetectorSettings
) -> Array:
    """Return the growth of the oscillation at each sample, by ``pieces`` [1/s]; NaN: there is none.

    Args:
        times: As of ``detect``, as the others.
        positions: See above.
        torques: See above.
        settings: See above; the position step is known.
    """
    growth = np.full(len(times), np.nan)
    for some, ticks, x, u in _stretches(times, positions, torques, settings):
        for piece in pieces(x, u, settings.period, settings.position_step):
            _note_growth(growth, piece, some, ticks)
    return growth


def _stretches(
    times: Array, positions: Array, torques: Array | None, settings: DetectorSettings
) -> Iterator[tuple[NDArray[np.intp], Array, Array, Array | None]]:
    """Yield the samples between two gaps, their ticks; positions and torques at every tick."""
    period = settings.period
    seen = np.flatnonzero(np.isfinite(positions))
    gaps = np.diff(times[seen]) > max(settings.tuning.recording.gap_s, 2.0 * period)
    for some in np.split(seen, np.flatnonzero(gaps) + 1) if seen.size else ():
        ticks = (times[some] - times[some[0]]) / period
        grid = np.arange(round(float(ticks[-1])) + 1.0)
        u = None if torques is None else _complete(grid, ticks, torques[some])
        yield some, ticks, np.interp(grid, ticks, positions[some]), u


def _near(piece: Piece, ticks: Array) -> NDArray[np.bool_]:
    """Return which samples belong to a piece's motion, some before and after it too."""
    near = _NEAR * (piece.end - piece.start)
    which: NDArray[np.bool_] = (ticks > piece.start - near) & (ticks < piece.end + near)
    return which


def _note_growth(
    growth: Array, piece: Piece, some: NDArray[np.intp], ticks: Array
) -> NDArray[np.intp]:
    """Note the growth inside of a piece, and near it where there is none; return the inside."""
    near = some[_near(piece, ticks)]
    growth[near[np.isnan(growth[near])]] = piece.rate.real
    inside = some[(ticks > piece.start - 0.5) & (ticks < piece.end - 0.5)]
    growth[inside] = piece.rate.real
    return inside


def _ticked(
    times: Array,
    positions: Array,
    torques: Array | None,
    settings: DetectorSettings,
    wall: KnownWall,
    stiffness: Array,
    lag: float,
) -> tuple[NDArray[np.int8], Array, Array, NDArray[np.bool_]]:
    """Run the detector of a run over the samples: state, frequency, amplitude, alarm."""
    n = len(times)
    detector = _detector(settings, wall, lag)
    own = _own_motion(settings, wall.side)
    surface = wall.surface if math.isfinite(wall.surface) else 0.0
    acting = ActingTorque(lag / settings.period)
    state, alarm = np.zeros(n, dtype=np.int8), np.zeros(n, dtype=np.bool_)
    frequency, amplitude = np.full(n, np.nan), np.zeros(n)
    commanded = [math.nan] * n if torques is None else np.asarray(torques, float).tolist()
    stiff = stiffness.tolist()
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
        if (own.alarm or own.steady) and state[k] < State.SUSTAINED:
            # Motion that neither the believed values nor a hand explains.
            state[k] = State.GROWING if own.alarm else State.SUSTAINED
            frequency[k], amplitude[k] = own.frequency_hz, own.amplitude
    return state, frequency, amplitude, alarm


def _complete(grid: Array, ticks: Array, torques: Array) -> Array | None:
    """Return torques on a grid, the missing ones interpolated; None: there are hardly any."""
    fine = np.isfinite(torques)
    if np.count_nonzero(fine) < 0.5 * torques.size:
        return None
    complete: Array = np.interp(grid, ticks[fine], torques[fine])
    return complete


def _rendered(piece: Piece, wall: KnownWall, stiffness: float) -> complex:
    """Return the torque of a known wall over the position, as phasors [N·m/rad]."""
    late = np.exp(-piece.rate * wall.inserted)
    return complex(-(stiffness + wall.virtual_damping * piece.rate) * late)


def _judged(
    piece: Piece,
    samples: int,
    settings: DetectorSettings,
    step: float,
    pull: complex,
    lag: float,
) -> State:
    """Return the state of an oscillation; quiet: a hand may make it.

    Args:
        piece: The oscillation.
        samples: Of the record, without a gap.
        settings: Known values of the servo.
        step: Encoder count [rad]; 0: none.
        pull: Torque over position, as phasors [N·m/rad]; NaN: not known.
        lag: Delay from a sample until its torque acts [s]; NaN: not known.
    """
    known = not cmath.isnan(pull)
    if known and not _moves(piece, settings, step, pull, lag):
        return State.QUIET
    sure = 2.0 * math.tau * piece.error / piece.rate.imag
    cycles = piece.cycles(settings.period)
    if piece.growth < -min(BORDER, max(0.5 * BORDER, sure)):
        return State.DECAYING
    whole = piece.end - piece.start > _WHOLE * samples
    many = cycles >= _MANY or (whole and cycles >= _UNKNOWN)
    if piece.growth > max(BORDER, sure):
        return State.GROWING if whole or many else State.QUIET
    return State.SUSTAINED if many or (known and whole) else State.QUIET


def _moves(
    piece: Piece, settings: DetectorSettings, step: float, pull: complex, lag: float
) -> bool:
    """Whether the torque moves the servo like this, without a hand.

    ``torque = J a + b v``, for the torque that acts: a sample's is held for a period after the lag.
    The inertia must be that of the servo, and the torque must not brake a motion that goes on.
    """
    rate, late = piece.rate, not math.isnan(lag)
    growth, speed = rate.real, rate.imag
    if late:
        pull *= cmath.exp(-rate * (lag + 0.5 * settings.period))
    inertia = (growth * pull.imag / speed - pull.real) / abs(rate) ** 2
    damping = pull.imag / speed - 2.0 * growth * inertia
    tuning, fine = settings.tuning.energy, step / piece.amplitude
    room = tuning.inertia_counts * fine
    share = inertia / settings.inertia if settings.inertia > 0.0 else 1.0
    moves = inertia > 0.0 and tuning.lightest - room < share < tuning.heaviest + room
    pays = not late or damping > -(tuning.loss + tuning.loss_counts * fine) * inertia * speed
    return moves and pays


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
