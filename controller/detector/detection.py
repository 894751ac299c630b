"""Judges a whole record by its oscillations: computes the result at every sample."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.envelope import Piece, pieces
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.state import State
from haptic_wall.controller.detector.tuning import TUNING
from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.laws.wall import Wall

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
_GAP_S: Final = 0.05
"""After a longer gap the motion is judged anew: turning points at 10 Hz may have passed unseen."""
_COUNT_STEPS: Final = 20
"""So many steps of the position are at least needed to tell a count."""
_ALARM_COUNTS: Final = 3.5
"""A sustained oscillation is an alarm from this amplitude on: a lightly damped wall of any
stiffness keeps up one or two counts."""
_LIGHTEST, _HEAVIEST = 1.0 / 1.3, 1.4
"""The torque moves the servo if the inertia seems to be between these ratios to the believed one,
which may be wrong by a fifth,"""
_INERTIA_COUNTS: Final = 1.0
"""and so many counts over the amplitude: its square is known to that."""
_LOSS, _LOSS_COUNTS = 0.02, 0.35
"""It brakes a motion if it takes more than this fraction of m ω, and so much by the counts."""
_ROUNDING: Final = 1e-9
"""Steps that are smaller than this fraction of the largest are rounding errors [1]"""


class DetectionRecord(NamedTuple):
    """The detector's results at every sample; arrays of one length."""

    times: Array
    """On the record's own clock [s]"""
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

    @property
    def worst(self) -> State:
        """Return the worst state."""
        return State(int(self.state.max(initial=State.QUIET)))

    @property
    def worst_at(self) -> int:
        """Return the sample of the largest amplitude in that state.

        A growing and a sustained oscillation are one.
        """
        of_it = self.state >= min(self.worst, State.SUSTAINED)
        return int(np.argmax(np.where(of_it, self.amplitude, -1.0)))

    @property
    def first_alarm_s(self) -> float:
        """Return the time of the first alarm [s]; NaN: none."""
        return float(self.times[np.argmax(self.alarm)]) if self.alarm.any() else math.nan

    @classmethod
    def joined(cls, records: Iterable[DetectionRecord]) -> DetectionRecord:
        """Return records that follow each other as one."""
        return cls(*map(np.concatenate, zip(*records, strict=True)))


@dataclass(frozen=True, slots=True)
class Known:
    """The known values of a record's servo and wall; NaN: not known."""

    period: float
    """T [s]"""
    inertia: float = math.nan
    """In commanded torque [kg·m²]"""
    position_step: float = math.nan
    """Encoder count [rad]; 0: not quantised"""
    lag: float = 0.0
    """Delay from a sample until its torque acts, >= 0 [s]"""
    stiffness: float = math.nan
    """Of the wall, where the torque is not recorded [N·m/rad]"""
    virtual_damping: float = 0.0
    """The same [N·m·s/rad]"""


def detect(times: Array, positions: Array, torques: Array | None, known: Known) -> DetectionRecord:
    """Judge a whole record by its oscillations; see ``pieces``.

    Args:
        times: Times of the samples, increasing, shape (n,) [s]. After a gap of more than 50 ms the
            motion is judged anew; shorter ones are interpolated.
        positions: Shape (n,) [rad]; samples with NaN are skipped.
        torques: Commanded with each sample, shape (n,) [N·m]; NaN where not known; None: those of
            the wall, if its stiffness is known.
        known: Known values of servo and wall; its period is the grid's. A missing position step is
            estimated from the record, if it has one.
    """
    n = len(times)
    period, step = known.period, known.position_step
    if math.isnan(step):
        step = position_step(positions)
    state, frequency, amplitude, alarm = _ticked(times, positions, torques, known, step)
    judged = np.zeros(n, dtype=np.bool_)
    found = []
    growth = np.full(n, np.nan)
    for some, ticks, x, u in _stretches(times, positions, torques, period):
        away = [np.abs(x - end) > 1.5 * step for end in (x[0], x[-1])]
        moving = x.size - int(np.argmax(away[0])) - int(np.argmax(away[1][::-1]))
        for piece in pieces(x, u, period, step):
            pull = piece.pull
            if u is None:  # that of a known wall
                pull = -(known.stiffness + known.virtual_damping * piece.rate)
            verdict = _judged(piece, moving, known, step, pull)
            room = _NEAR * (piece.end - piece.start)
            near = some[(ticks > piece.start - room) & (ticks < piece.end + room)]
            growth[near[np.isnan(growth[near])]] = piece.rate.real
            inside = some[(ticks > piece.start - 0.5) & (ticks < piece.end - 0.5)]
            growth[inside] = piece.rate.real
            if verdict or piece.growth < BORDER:
                judged[near] = True
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
        large = size >= _ALARM_COUNTS * step
        alarm[inside] = large & (verdict >= State.SUSTAINED)
    growth[state == State.QUIET] = np.nan
    return DetectionRecord(np.asarray(times, float), state, frequency, amplitude, growth, alarm)


def _stretches(
    times: Array, positions: Array, torques: Array | None, period: float
) -> Iterator[tuple[NDArray[np.intp], Array, Array, Array | None]]:
    """Yield the samples between two gaps, their ticks; positions and torques at every tick."""
    seen = np.flatnonzero(np.isfinite(positions))
    gaps = np.diff(times[seen]) > max(_GAP_S, 2.0 * period)
    for some in np.split(seen, np.flatnonzero(gaps) + 1) if seen.size else ():
        ticks = (times[some] - times[some[0]]) / period
        grid = np.arange(round(float(ticks[-1])) + 1.0)
        u = None if torques is None else _complete(grid, ticks, torques[some])
        yield some, ticks, np.interp(grid, ticks, positions[some]), u


def _ticked(
    times: Array, positions: Array, torques: Array | None, known: Known, step: float
) -> tuple[NDArray[np.int8], Array, Array, NDArray[np.bool_]]:
    """Run the watch of a run over the samples: state, frequency, amplitude, alarm.

    It sees an oscillation at the torque limit, whose period changes as it grows: no sinusoid fits.
    """
    n, period = len(times), known.period
    believed = not math.isnan(known.inertia)
    watch = Watch(
        WatchSettings(
            period,
            step,
            light=known.inertia if believed else 0.0,
            heavy=known.inertia if believed else math.inf,
            passive=not believed or torques is None,
            regular_long=TUNING.steady,
        )
    )
    law = Wall(0.0, 0.0, 0.0, "both")
    state, alarm = np.zeros(n, dtype=np.int8), np.zeros(n, dtype=np.bool_)
    frequency, amplitude = np.full(n, np.nan), np.zeros(n)
    commanded = [0.0] * n if torques is None else np.nan_to_num(torques).tolist()
    when, where = np.asarray(times, float).tolist(), np.asarray(positions, float).tolist()
    last: float | None = None
    for k in range(n):
        if math.isfinite(where[k]):
            gap = 0.0 if last is None else when[k] - last
            last = when[k]
            if gap > max(_GAP_S, 2.0 * period):
                watch.resume()
            watch.sample(where[k], law, math.nan, max(1, round(gap / period)))
        watch.sent(commanded[k])
        if watch.current:
            state[k], alarm[k] = watch.current, watch.alarm
            frequency[k], amplitude[k] = watch.seen
    return state, frequency, amplitude, alarm


def _complete(grid: Array, ticks: Array, torques: Array) -> Array | None:
    """Return torques on a grid, the missing ones interpolated; None: there are hardly any."""
    fine = np.isfinite(torques)
    if np.count_nonzero(fine) < 0.5 * torques.size:
        return None
    complete: Array = np.interp(grid, ticks[fine], torques[fine])
    return complete


def _judged(piece: Piece, samples: int, known: Known, step: float, pull: complex) -> State:
    """Return the state of an oscillation; quiet: a hand may make it.

    Args:
        piece: The oscillation.
        samples: Of the record, without a gap.
        known: Known values of the servo.
        step: Encoder count [rad]; 0: none.
        pull: Torque over position, as phasors [N·m/rad]; NaN: not known.
    """
    pulls = not cmath.isnan(pull)
    if pulls and not _moves(piece, known, step, pull):
        return State.QUIET
    sure = 2.0 * math.tau * piece.error / piece.rate.imag
    cycles = piece.cycles(known.period)
    if piece.growth < -min(BORDER, max(0.5 * BORDER, sure)):
        return State.DECAYING
    whole = piece.end - piece.start > _WHOLE * samples
    many = cycles >= _MANY or (whole and cycles >= _UNKNOWN)
    if piece.growth > max(BORDER, sure):
        return State.GROWING if whole or many else State.QUIET
    return State.SUSTAINED if many or (pulls and whole) else State.QUIET


def _moves(piece: Piece, known: Known, step: float, pull: complex) -> bool:
    """Whether the torque moves the servo like this, without a hand.

    ``torque = J a + b v``, for the torque that acts: a sample's is held for a period after the lag.
    The inertia must be that of the servo, and the torque must not brake a motion that goes on.
    """
    rate, late = piece.rate, not math.isnan(known.lag)
    growth, speed = rate.real, rate.imag
    if late:
        pull *= cmath.exp(-rate * (known.lag + 0.5 * known.period))
    inertia = (growth * pull.imag / speed - pull.real) / abs(rate) ** 2
    damping = pull.imag / speed - 2.0 * growth * inertia
    fine = step / piece.amplitude
    room = _INERTIA_COUNTS * fine
    share = inertia / known.inertia if known.inertia > 0.0 else 1.0
    moves = inertia > 0.0 and _LIGHTEST - room < share < _HEAVIEST + room
    pays = not late or damping > -(_LOSS + _LOSS_COUNTS * fine) * inertia * speed
    return moves and pays


def position_step(positions: Array) -> float:
    """Return the encoder step [rad] if all positions differ by multiples of one step; else 0."""
    steps = np.abs(np.diff(positions[np.isfinite(positions)]))
    steps = steps[steps > _ROUNDING * np.max(steps, initial=0.0)]
    if steps.size < _COUNT_STEPS:
        return 0.0
    # Files are rounded to some digits, which limits the precision of the smallest difference.
    smallest = float(np.median(steps[steps < 1.5 * steps.min()]))
    counts = steps[steps < 20.0 * smallest] / smallest
    whole = bool(np.mean(np.abs(counts - np.rint(counts)) < 0.1) > 0.99)
    # Without an encoder step the smallest difference is far below most others.
    return smallest if whole and counts.size > 0.5 * steps.size else 0.0
