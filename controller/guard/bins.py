"""Computes the guard's decision for each bin of sample age and interval of the gain schedule.

A rigid servo is least safe at the longest age and interval of a bin. A flexible one may be less
safe at any other, so that its limits are the least over the whole bin.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace

from haptic_wall.controller.guard.guard import Decision, GuardSettings, Request, Situation, decide
from haptic_wall.controller.guard.plants import is_heavy
from haptic_wall.controller.guard.schedule import IRREGULAR_CAP, inserted_delays, served_range
from haptic_wall.controller.guard.work import Work

COARSE = 6
"""Off the nominal period only every n-th age has a decision of its own; the ages below share it [1]
"""
_OLDER = 1.2
"""With a link, off the nominal period: ratio of the mean delays of two ages that are decided"""


def decide_bins(
    request: Request,
    settings: GuardSettings,
    situation: Situation,
    steps: int,
    ages_ns: Sequence[int],
    intervals_ns: Sequence[int],
    work: Work | None = None,
) -> list[list[Decision]]:
    """Decide for all bins, without reasons.

    Args:
        request: The requested wall.
        settings: The guard's settings at the nominal period.
        situation: The belief and the limits, with the nominal period.
        steps: Inserted delay [periods].
        ages_ns: Upper ends of the bins of the sample age, rising [ns].
        intervals_ns: Upper ends of the bins of the interval, rising, the period first [ns].
        work: What was evaluated before for the same asker.

    Returns:
        For each interval one decision for each age.

    Raises:
        ValueError: As for ``decide``.
    """
    work = Work() if work is None else work
    return [
        decide_bin(request, settings, situation, steps, ages_ns, intervals_ns, index, work)
        for index in range(len(intervals_ns))
    ]


def decide_bin(
    request: Request,
    settings: GuardSettings,
    situation: Situation,
    steps: int,
    ages_ns: Sequence[int],
    intervals_ns: Sequence[int],
    index: int,
    work: Work | None = None,
) -> list[Decision]:
    """Decide for all ages at the bin ``index`` of the interval; arguments as of ``decide_bins``."""
    there, (least, most) = _at(situation, steps, intervals_ns, index)
    ages = _decided_ages(there, ages_ns, index, most)
    found = decide(
        request,
        settings_at(settings, index),
        there,
        [most + age * 1e-9 for age in ages],
        most,
        explained=False,
        least_inserted=least,
        work=work,
    )
    return [found[bisect_left(ages, age)] for age in ages_ns]


def explained(
    request: Request,
    settings: GuardSettings,
    situation: Situation,
    steps: int,
    ages_ns: Sequence[int],
    intervals_ns: Sequence[int],
    index: int,
    work: Work | None = None,
) -> Decision:
    """Decide for one bin, with reasons; other arguments as of ``decide_bins``.

    ``index`` counts the bins interval by interval, one for each age.
    """
    at, age = divmod(index, len(ages_ns))
    numbers = decide_bin(request, settings, situation, steps, ages_ns, intervals_ns, at, work)[age]
    there, (least, most) = _at(situation, steps, intervals_ns, at)
    told = decide(
        request,
        settings_at(settings, at),
        there,
        [numbers.delay - situation.belief.delay.high],
        most,
        least_inserted=least,
        work=work,
    )[0]
    return replace(numbers, reasons=told.reasons)


def settings_at(settings: GuardSettings, index: int) -> GuardSettings:
    """Return the guard's settings in the bin ``index`` of the interval."""
    if index == 0:
        return settings
    return replace(settings, damping_cap=IRREGULAR_CAP * settings.damping_cap)


def _at(
    situation: Situation, steps: int, intervals_ns: Sequence[int], index: int
) -> tuple[Situation, tuple[float, float]]:
    """Return the situation in a bin of the interval, and the range of the inserted delay there."""
    served = served_range(intervals_ns, index)
    interval = situation.period if index == 0 else intervals_ns[index] * 1e-9
    covered = served if situation.belief.is_flexible else (served[0], 1.0)
    inserted = inserted_delays(steps, situation.period, interval, covered)
    there = replace(situation, period=interval, sampled=situation.period, served=served)
    return there, inserted


def _decided_ages(
    situation: Situation, ages_ns: Sequence[int], index: int, inserted: float
) -> list[int]:
    """Return the ages that get a decision of their own [ns]; the last is one of them."""
    if index == 0 and not is_heavy(situation):
        return list(ages_ns)
    if not situation.belief.is_flexible:
        some = list(ages_ns[COARSE - 1 :: COARSE])
        return some if some and some[-1] == ages_ns[-1] else [*some, ages_ns[-1]]
    before = 0.5 * situation.period + inserted + situation.belief.delay.high
    some = []
    for age in reversed(ages_ns):
        if not some or (before + some[-1] * 1e-9) > _OLDER * (before + age * 1e-9):
            some.append(age)
    return some[::-1]
