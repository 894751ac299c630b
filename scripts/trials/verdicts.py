"""Judges trials for the tables: self-sustained motion, detection, largest amplitude."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from haptic_wall.controller.detector.oscillation import State
from haptic_wall.controller.detector.tuning import TUNING, Tuning
from scripts.trials.cases import Case
from scripts.trials.draws import bench_of
from scripts.trials.judges import (
    LOST,
    SMALL_COUNTS,
    OwnOscillation,
    ending,
    half_cycles,
    large,
    own_oscillation,
)
from scripts.trials.run import Trial

WINDOW_S = 4.0
"""Time at the end of a trial in which a motion must persist to count as self-sustained [s]"""
_RIPPLE = 0.5
"""Smallest reversal that ends a half-cycle, relative to the amplitude of interest."""
_LONGER_S = 12.0
"""Additional time of a repeated trial that was too short for a verdict [s]."""


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


def longest_unseen_s(trial: Trial) -> float:
    """Return the longest time for which a motion above four counts neither decays nor is found [s].

    A half-cycle counts if it has kept 99 % of the amplitude of a cycle before, and the detector
    mostly says quiet or decaying in it.
    """
    cycles = half_cycles(trial, 0.0, _RIPPLE * small())
    loud = cycles.sustained & (cycles.amplitude > small()) & np.isfinite(cycles.last)
    seen = np.cumsum(np.concatenate([[0], trial.state >= State.SUSTAINED]))
    begin = np.round(cycles.begin_s / trial.period).astype(np.int64)
    end = np.minimum(np.round(cycles.end_s / trial.period).astype(np.int64), trial.state.size)
    quiet = (seen[end] - seen[begin]) < 0.5 * (end - begin)
    longest = time = 0.0
    for counts, first, last in zip((loud & quiet).tolist(), begin, end, strict=True):
        time = time + (last - first) * trial.period if counts else 0.0
        longest = max(longest, time)
    return longest


def time_above_s(trial: Trial, above: float) -> float:
    """Return when the last half-cycle above an amplitude ends [s]; 0: there is none."""
    cycles = half_cycles(trial, 0.0, _RIPPLE * above)
    over = cycles.end_s[cycles.amplitude > above]
    return float(over[-1]) if over.size else 0.0


@dataclass(frozen=True, slots=True)
class Answered:
    """Outcome of ``reduce`` on an oscillation."""

    case: Case
    in_time: bool
    """It decays, or the run has ended, before the deadline"""
    late_s: float
    """Time after the deadline until it decays, or the run ends [s]; 0: in time"""
    late_at_any_speed: bool
    """It is late with the trip by speed too"""
    never: bool
    """It persists until the end of the trial"""
    trip: str | None
    gave_up: bool
    """The backstop ended the run; another trip by oscillation is by energy, or by belief"""
    unseen: bool
    """It persists above four counts at the end, and is called quiet or decaying"""
    alarm_s: float
    """NaN: there was no alarm"""
    at_alarm: float
    """Largest amplitude until the alarm; NaN without one [rad]"""
    after: float
    """Largest amplitude after it; NaN without one [rad]"""


def goes_on_by_itself(case: Case) -> bool:
    """Whether the case's wall sustains a large oscillation while the detector only reports."""
    return sustains(case.run("report"), large(case.truth.counts_per_rev))


def answered(case: Case, tuning: Tuning = TUNING) -> Answered:
    """Run a case with ``reduce`` and judge it; repeat it longer if it was too short."""
    trial, own = until_judged(case, tuning=tuning)
    late_at_any_speed = False
    if not own.in_time:
        limited = _longer(case).run(speed_limits=True, tuning=tuning)
        late_at_any_speed = not _judged(case, limited).in_time
    over = own.ended_s if own.tripped else own.decays_s
    at_alarm, after = at_alarm_and_after(trial)
    return Answered(
        case=case,
        in_time=own.in_time,
        late_s=0.0 if own.in_time else over - own.deadline_s,
        late_at_any_speed=late_at_any_speed,
        never=not (own.in_time or own.tripped) and own.decays_s > own.ended_s - WINDOW_S,
        trip=trial.trip,
        gave_up=trial.gave_up,
        unseen=unseen(trial),
        alarm_s=trial.first_alarm_s,
        at_alarm=at_alarm,
        after=after,
    )


def at_alarm_and_after(trial: Trial) -> tuple[float, float]:
    """Return the largest distance from the surface until the first alarm, and after it [rad]."""
    if math.isnan(trial.first_alarm_s):
        return math.nan, math.nan
    away = np.abs(trial.output)
    at = min(max(1, round(trial.first_alarm_s / trial.period)), away.size)
    return float(away[:at].max()), float(away[at:].max(initial=0.0))


def until_judged(
    case: Case, answer: str = "reduce", tuning: Tuning = TUNING
) -> tuple[Trial, OwnOscillation]:
    """Run a case and judge it; repeat it longer if it was too short for a verdict, or late."""
    trial = case.run(answer, tuning=tuning)
    own = _judged(case, trial)
    if not own.judged or not own.in_time:
        trial = _longer(case).run(answer, tuning=tuning)
        own = _judged(case, trial)
    return trial, own


def _longer(case: Case) -> Case:
    return replace(case, duration_s=case.duration_s + _LONGER_S)


def _judged(case: Case, trial: Trial) -> OwnOscillation:
    belief = bench_of(case.preset).belief
    return own_oscillation(trial, belief, counts_per_rev=case.truth.counts_per_rev)
