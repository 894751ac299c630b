"""Computes the guard's decision for each bin of sample age and interval of the gain schedule.

A rigid servo is least safe at the longest age and interval of a bin. A flexible one may be less
safe at any other, so that its limits are the least over the whole bin.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from haptic_wall.controller.guard.guard import decide
from haptic_wall.controller.guard.plants import is_heavy
from haptic_wall.controller.guard.reasons import explain
from haptic_wall.controller.guard.schedule import IRREGULAR_CAP
from haptic_wall.controller.guard.types import WITHIN, Decision, GuardSettings, Request, Situation
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.milliseconds import ms

_OLDER = 1.1
"""Ratio of the mean delays of two ages that are decided, where not every age is [1]"""


@dataclass(frozen=True, slots=True)
class Bins:
    """The bins of a wall. All that decides raises ``ValueError`` as ``decide`` does."""

    request: Request
    settings: GuardSettings
    """At the nominal period"""
    situation: Situation
    """With the nominal period"""
    steps: int
    """Inserted delay [periods]"""
    ages_ns: Sequence[int]
    """Upper ends of the bins of the sample age, rising [ns]"""
    intervals_ns: Sequence[int]
    """Upper ends of the bins of the interval, rising, the period first [ns]"""
    work: Work = field(default_factory=Work)
    """Results of earlier evaluations"""

    def decide(self) -> list[Decision]:
        """Decide for all bins, without reasons but the last.

        Returns:
            Interval by interval one decision for each age; last, with its reason, that for all
            older ages and longer intervals: no wall, but in mode ``off``.
        """
        indices = range(len(self.intervals_ns))
        found = [decision for index in indices for decision in self.decide_interval(index)]
        return [*found, self._beyond(found[-1])]

    def decide_interval(self, index: int) -> list[Decision]:
        """Decide for all ages at a bin of the interval."""
        settings, situation = self.at(index)
        ages = self._decided_ages(index)
        delays = [situation.inserted[1] + age * 1e-9 for age in ages]
        found = decide(self.request, settings, situation, delays, self.work)
        return [found[bisect_left(ages, age)] for age in self.ages_ns]

    def explained(self, index: int) -> Decision:
        """Decide for one bin, with reasons; ``index`` counts as the result of ``decide``."""
        at, age = divmod(index, len(self.ages_ns))
        if at == len(self.intervals_ns):
            return self._beyond(self.explained(index - 1))
        return explain(self.decide_interval(at)[age], *self.at(at), self.work)

    def _beyond(self, last: Decision) -> Decision:
        """Return the decision for what is older or longer than every bin."""
        if self.settings.mode == "off":
            return last
        intervals = self.intervals_ns
        text = (
            f"the wall fades out: samples are older than {ms(self.ages_ns[-1] * 1e-9)}, or more"
            f" than {intervals[-1] / intervals[0]:g} periods pass between readings"
        )
        return replace(last, stiffness=0.0, damping=0.0, binding=None, reasons=(text,))

    def at(self, index: int) -> tuple[GuardSettings, Situation]:
        """Return settings and situation in a bin of the interval.

        A torque leaves the ring of the inserted delay in the first tick that is at least ``steps``
        periods of the grid later. Where ticks lie anywhere between the points of the grid, that is
        up to an interval later than the last point before.
        """
        settings, situation, intervals = self.settings, self.situation, self.intervals_ns
        interval = period = situation.period
        shortest, longest = 1.0, WITHIN if situation.belief.is_flexible else 1.0
        if index > 0:
            interval = intervals[index] * 1e-9
            shortest = WITHIN * intervals[index - 1] / intervals[index]
            settings = replace(settings, damping_cap=IRREGULAR_CAP * settings.damping_cap)
        inserted = (0.0, 0.0)
        if self.steps:
            inserted = (self.steps * period, (self.steps - 1) * period + longest * interval)
        served = shortest, WITHIN
        return settings, replace(
            situation, period=interval, sampled=period, served=served, inserted=inserted
        )

    def _decided_ages(self, index: int) -> list[int]:
        """Return the ages that get a decision of their own [ns]; the last is one of them."""
        if index == 0 and not is_heavy(self.situation, self.request.velocity_samples):
            return list(self.ages_ns)
        _, situation = self.at(index)
        before = 0.5 * situation.period + situation.inserted[1] + situation.belief.delay.high
        some: list[int] = []
        for age in reversed(self.ages_ns):
            if not some or (before + some[-1] * 1e-9) > _OLDER * (before + age * 1e-9):
                some.append(age)
        return some[::-1]
