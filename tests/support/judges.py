"""Judges a trial's true motion: half-cycles, self-sustained oscillation, decay."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.detector.state import State
from haptic_wall.controller.experiments.sweep.decrement import reversals
from haptic_wall.controller.guard.belief import Belief
from haptic_wall.controller.theory.checks import FloatArray
from tests.support.trial import Trial

LARGE_RAD = math.radians(1.0)
LARGE_COUNTS = 10.0
"""The smaller of the two is the amplitude to either side above which an oscillation is large."""
SMALL_COUNTS = 4.0
"""Amplitude above which no self-sustained motion may be called quiet or decaying."""
MOST_CYCLES, LONGEST_S = 6.0, 5.0
"""Cycles of the slowest believed frequency within which it must decay, and the longest time [s]"""
LOST = 0.01
"""Fraction of its amplitude that a decaying oscillation loses per cycle."""
WINDOW_S = 4.0
"""Time at the end of a trial in which a motion must persist to count as self-sustained [s]"""
_NOISE_RAD = 1e-4
"""Smallest half-cycle [rad]: a fifteenth of a count of 4096."""
_RIPPLE = 0.5
"""Smallest reversal that ends a half-cycle, relative to the amplitude of interest: a quarter of
such a half-cycle's path."""


@dataclass(frozen=True, slots=True)
class HalfCycles:
    """From each turning point of the true motion to the next; arrays of shape (n,)."""

    begin_s: FloatArray
    end_s: FloatArray
    amplitude: FloatArray
    """Half the way between the two turning points [rad]"""
    last: FloatArray
    """Amplitude of the one two before, on the same side; infinite for the first two [rad]"""

    @property
    def sustained(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Return which half-cycles have lost less than ``LOST`` of their amplitude in a cycle."""
        kept: np.ndarray[tuple[int], np.dtype[np.bool_]] = self.amplitude >= self.last * (
            1.0 - LOST
        )
        return kept


def half_cycles(trial: Trial, since_s: float = 0.0, least: float = _NOISE_RAD) -> HalfCycles:
    """Return the half-cycles of the true output.

    The last turning point counts if the motion has come back from it; a start at rest is the first.

    Args:
        trial: The record.
        since_s: Where to begin, such as an operator's release [s].
        least: Smaller reversals are ripples on a half-cycle [rad].
    """
    first = round(since_s / trial.period)
    output = trial.output[first:]
    if output.size == 0:
        none = np.empty(0)
        return HalfCycles(none, none, none, none)
    found = reversals(output, least)
    at = np.array([0.0, *(0.5 * (a + b) for a, b in found)])
    place = output[np.array([0, *(a for a, _ in found)], dtype=np.int64)]
    time = (at + first) * trial.period
    amplitude = 0.5 * np.abs(np.diff(place))
    last = np.concatenate([[math.inf, math.inf], amplitude])[: amplitude.size]
    return HalfCycles(time[:-1], time[1:], amplitude, last)


def large(counts_per_rev: int) -> float:
    """Return the amplitude above which an oscillation is large [rad]."""
    if not counts_per_rev:
        return LARGE_RAD
    return min(LARGE_RAD, LARGE_COUNTS * math.tau / counts_per_rev)


@dataclass(frozen=True, slots=True)
class OwnOscillation:
    """An oscillation that the wall makes by itself."""

    onset_s: float
    """End of the first half-cycle above the threshold that the next one on the same side has not
    lost a part of: a kick that dies is no oscillation yet [s]; NaN: there was none"""
    decays_s: float
    """End of the last half-cycle above the threshold that did not decay [s], ``onset_s`` at least;
    NaN: there was no onset"""
    deadline_s: float
    """When it must have decayed, or the run be over [s]; NaN: there was no onset"""
    ended_s: float
    """End of the trial [s]"""
    tripped: bool
    """A trip has ended it"""
    largest: float
    """Amplitude of the largest half-cycle; those below a quarter of the threshold are 0 [rad]"""
    stiffness: float
    """Commanded at the onset [N·m/rad]; NaN: there was no onset"""

    @property
    def in_time(self) -> bool:
        """Whether it decayed, or the run ended, before the deadline; or there was none.

        A trial must continue beyond the deadline; before its end there is no verdict.
        """
        if math.isnan(self.onset_s):
            return True
        if self.tripped and self.ended_s <= self.deadline_s:
            return True
        return self.decays_s <= self.deadline_s

    @property
    def judged(self) -> bool:
        """Whether the trial was long enough for a verdict."""
        return math.isnan(self.onset_s) or self.tripped or self.ended_s > self.deadline_s


def own_oscillation(trial: Trial, belief: Belief, *, counts_per_rev: int = 4096) -> OwnOscillation:
    """Judge a motion without an operator.

    Args:
        trial: The record.
        belief: Its lowest gain and highest inertia give the slowest frequency.
        counts_per_rev: Counts per revolution of the encoder.
    """
    threshold = large(counts_per_rev)
    cycles = half_cycles(trial, 0.0, _RIPPLE * threshold)
    ended = trial.output.size * trial.period
    above = cycles.amplitude > threshold
    kept_on = np.zeros_like(above)
    kept_on[:-2] = cycles.sustained[2:]
    begins = above & kept_on
    onset = decays = deadline = stiffness = math.nan
    if begins.any():
        onset = decays = float(cycles.end_s[begins][0])
        kept = above & cycles.sustained & np.isfinite(cycles.last)
        if kept.any():
            decays = max(onset, float(cycles.end_s[kept][-1]))
        at_onset = min(round(onset / trial.period), trial.output.size - 1)
        stiffness = float(trial.stiffness[at_onset])
        deadline = onset + deadline_after(belief, stiffness)
    return OwnOscillation(
        onset_s=onset,
        decays_s=decays,
        deadline_s=deadline,
        ended_s=ended,
        tripped=trial.trip is not None,
        largest=float(cycles.amplitude.max(initial=0.0)),
        stiffness=stiffness,
    )


def deadline_after(belief: Belief, stiffness: float) -> float:
    """Return the time that an oscillation at this commanded stiffness may take to decay [s].

    Six cycles of ``sqrt(g_low K / m_high) / 2 pi``, at most 5 s.
    """
    if not stiffness > 0.0:
        return LONGEST_S
    rate = math.sqrt(belief.torque_gain.low * stiffness / belief.inertia.high)
    return min(MOST_CYCLES * math.tau / rate, LONGEST_S)


@dataclass(frozen=True, slots=True)
class Ending:
    """The motion at the end of a trial, without an operator."""

    amplitude: float
    """Amplitude of the smallest half-cycle in the window [rad]; 0 where there were fewer than
    four"""
    quiet: float
    """Fraction of the window's ticks in which the detector says quiet or decaying [1]"""


def ending(trial: Trial, window_s: float = 2.0, *, counts_per_rev: int = 4096) -> Ending:
    """Return the motion at the end: a self-sustained one has half-cycles throughout.

    Args:
        trial: The record.
        window_s: Before its end [s].
        counts_per_rev: Counts per revolution of the encoder; it defines a ripple.
    """
    since = max(0.0, trial.output.size * trial.period - window_s)
    cycles = half_cycles(trial, since, _RIPPLE * SMALL_COUNTS * math.tau / counts_per_rev)
    state = trial.state[round(since / trial.period) :]
    quiet = float(np.mean(state < State.SUSTAINED)) if state.size else 1.0
    # The first one begins anywhere; gaps longer than twice the usual mean rest.
    amplitude, end_s = cycles.amplitude[1:], cycles.end_s[1:]
    if amplitude.size < 4:
        return Ending(0.0, quiet)
    length = np.diff(end_s)
    rests = float(np.max(length)) > 3.0 * float(np.median(length))
    left = trial.output.size * trial.period - float(end_s[-1])
    stopped = left > 3.0 * float(np.median(length))
    smallest = 0.0 if rests or stopped else float(amplitude.min())
    return Ending(smallest, quiet)


def small(trial_counts: int = 4096) -> float:
    """Return the amplitude of four counts [rad]."""
    return SMALL_COUNTS * math.tau / trial_counts


def sustains(trial: Trial, above: float, window_s: float = WINDOW_S) -> bool:
    """Whether a motion with half-cycles above an amplitude sustains itself until the end.

    Args:
        trial: The record, without an operator but for a constant push.
        above: Amplitude of every half-cycle in the window [rad].
        window_s: Before the end [s].
    """
    if ending(trial, window_s).amplitude <= above:
        return False
    since = max(0.0, trial.output.size * trial.period - window_s)
    size = half_cycles(trial, since, _RIPPLE * above).amplitude[1:]
    if size.size < 4:
        return False
    cycles = 0.5 * (size.size - 2)
    least = float(np.mean(size[:2])) * (1.0 - LOST) ** cycles
    return bool(np.mean(size[-2:]) >= least)


def unseen(trial: Trial, window_s: float = WINDOW_S) -> bool:
    """Whether a motion above four counts persists to the end, called quiet or decaying."""
    window = trial.state[-round(window_s / trial.period) :]
    called = float(np.mean(window < State.SUSTAINED)) > 0.5
    return called and trial.trip is None and sustains(trial, small(), window_s)


def time_above_s(trial: Trial, above: float) -> float:
    """Return when the last half-cycle above an amplitude ends [s]; 0: there is none."""
    cycles = half_cycles(trial, 0.0, _RIPPLE * above)
    over = cycles.end_s[cycles.amplitude > above]
    return float(over[-1]) if over.size else 0.0


def called_quiet(trial: Trial) -> bool:
    """Whether a motion above four counts goes on in the last two seconds as quiet or decaying."""
    end = ending(trial)
    return end.amplitude > small() and end.quiet > 0.5
