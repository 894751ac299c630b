"""Judges cases: walls that oscillate by themselves, what becomes of them, and operators' trials."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tests.support.judges import (
    WINDOW_S,
    large,
    own_oscillation,
    small,
    sustains,
    time_above_s,
    unseen,
)
from tests.support.operators import Operator, operator_of
from tests.support.trial import Case, Trial
from tests.support.truths_drawn import bench_of

WORSE = 1.5
"""Growth of the amplitude after an alarm that is too much [1]"""
_LONGER_S = 12.0
"""Additional time of a repeated trial that was too short for a verdict [s]."""
_SMALL_CYCLE_S = 25.0
"""Length of a trial of a small limit cycle with ``reduce`` [s]"""
_GOES_ON_S = 8.0
"""Time for which a motion is watched without the operator [s]"""
_BEFORE_S = 1.0
"""Time before an alarm over which the operator's mean push is taken [s]"""
_CYCLES = 5.0
"""After so many cycles passivity control must hold a wall."""


@dataclass(frozen=True, slots=True)
class Answered:
    """What becomes of an oscillation."""

    case: Case
    in_time: bool
    """It decays, or the run has ended, before the deadline"""
    late_s: float
    """Time after the deadline until it decays, or the run ends [s]; 0: in time"""
    never: bool
    """It persists until the end of the trial"""
    trip: str | None
    unseen: bool
    """It persists above four counts at the end, and is called quiet or decaying"""
    alarm_s: float
    """NaN: there was no alarm"""
    at_alarm: float
    """Largest amplitude until the alarm; NaN without one [rad]"""
    after: float
    """Largest amplitude after it; NaN without one [rad]"""

    @property
    def growth(self) -> float:
        """Return the largest amplitude after the alarm over that until then; NaN: no alarm."""
        return self.after / self.at_alarm if self.at_alarm else math.inf


def oscillation(case: Case) -> Answered | None:
    """Return what ``reduce`` makes of a wall that sustains a large oscillation; None: it does not.

    It is judged while the detector only reports; one that is late runs again for longer.
    """
    counts = case.truth.counts_per_rev
    if not sustains(case.run("report"), large(counts)):
        return None
    belief = bench_of(case.preset).belief
    trial = case.run()
    own = own_oscillation(trial, belief, counts_per_rev=counts)
    if not own.judged or not own.in_time:
        trial = replace(case, duration_s=case.duration_s + _LONGER_S).run()
        own = own_oscillation(trial, belief, counts_per_rev=counts)
    at_alarm, after = _grown(trial)
    over = own.ended_s if own.tripped else own.decays_s
    return Answered(
        case=case,
        in_time=own.in_time,
        late_s=0.0 if own.in_time else over - own.deadline_s,
        never=not (own.in_time or own.tripped) and own.decays_s > own.ended_s - WINDOW_S,
        trip=trial.trip,
        unseen=unseen(trial),
        alarm_s=trial.first_alarm_s,
        at_alarm=at_alarm,
        after=after,
    )


def small_cycle(case: Case) -> Answered | None:
    """Return what ``reduce`` makes of a motion that stays above four counts; None: it does not.

    It must be smaller in the last four seconds of a longer trial, without a trip.
    """
    if not sustains(case.run("report"), small()):
        return None
    trial = replace(case, duration_s=_SMALL_CYCLE_S).run()
    deadline_s = trial.output.size * trial.period - WINDOW_S
    below_s = time_above_s(trial, small())
    at_alarm, after = _grown(trial)
    in_time = trial.trip is None and below_s < deadline_s
    return Answered(
        case=case,
        in_time=in_time,
        late_s=0.0 if in_time else max(below_s - deadline_s, 0.0),
        never=trial.trip is None and not in_time,
        trip=trial.trip,
        unseen=unseen(trial),
        alarm_s=trial.first_alarm_s,
        at_alarm=at_alarm,
        after=after,
    )


def controlled(case: Case) -> Answered:
    """Return whether passivity control holds a wall above its limit at 1.5 times the kick.

    An alarm is a trip; a torque at its limit after half a cycle is no control.
    """
    trial = case.run("trip")
    natural = math.sqrt(case.truth.inertia / case.wall.stiffness)
    cycle = math.tau * natural / trial.period
    away = np.abs(trial.output)
    late = float(away[round(_CYCLES * cycle) :].max(initial=0.0))
    saturated = bool(np.any(trial.saturated[round(0.5 * cycle) :]))
    held = trial.trip is None and not saturated and late <= WORSE * case.position
    never = not held and trial.trip is None
    alarm = (trial.first_alarm_s, *_grown(trial))
    return Answered(case, held, 0.0, never, trial.trip, False, *alarm)


def _grown(trial: Trial) -> tuple[float, float]:
    """Return the largest distance from the surface until the alarm, and after it [rad]."""
    if math.isnan(trial.first_alarm_s):
        return math.nan, math.nan
    away = np.abs(trial.output)
    at = min(max(1, round(trial.first_alarm_s / trial.period)), away.size)
    return float(away[:at].max()), float(away[at:].max(initial=0.0))


@dataclass(frozen=True, slots=True)
class Held:
    """The result of an operator on a wall."""

    case: Case
    seconds: float
    probes: int
    softened: int
    """Alarms of the backstop"""
    trip: str | None
    goes_on: bool
    """After the first alarm the motion persists without the operator: the wall makes it"""


def held(case: Case) -> Held:
    """Run a case with an operator with ``reduce`` and judge it."""
    trial = case.run()
    probes, _, softened = trial.counts
    return Held(
        case=case,
        seconds=trial.output.size * trial.period,
        probes=probes,
        softened=softened,
        trip=trial.trip,
        goes_on=not math.isnan(trial.first_alarm_s) and _goes_on(case, trial),
    )


def _goes_on(case: Case, trial: Trial) -> bool:
    """Whether the motion at the first alarm sustains itself without the operator's work.

    From then on the operator lets go, holds still, or pushes with its mean torque.
    """
    at = round(trial.first_alarm_s * 1e3)
    before = case.moved_by()
    since = max(0, round(trial.first_alarm_s / trial.period) - round(_BEFORE_S / trial.period))
    push = -case.truth.torque_gain * float(np.mean(trial.torque[since : since + 1000]))
    spring, damper, wanted, _, _ = before.rows[min(at, len(before.rows) - 1)]
    rest = np.zeros(round(_GOES_ON_S * 1e3))
    watched = replace(case, duration_s=trial.first_alarm_s + _GOES_ON_S)
    for after in (
        operator_of(0.0, 0.0, rest),
        operator_of(spring, damper, rest + wanted),
        operator_of(0.0, 0.0, rest, push=push),
    ):
        rows = [*before.rows[:at], *after.rows]
        if sustains(watched.run("report", Operator(rows, before.mass)), small()):
            return True
    return False
