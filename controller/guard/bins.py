"""Computes the guard's decision for each bin of sample age and interval of the gain schedule.

A rigid servo is least safe at the longest age and interval of a bin. A flexible one may be less
safe at any other, so that its limits are the least over the whole bin.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace

from haptic_wall.controller.guard.delay_parts import ms
from haptic_wall.controller.guard.guard import Decision, GuardSettings, Request, Situation, decide
from haptic_wall.controller.guard.plants import is_heavy
from haptic_wall.controller.guard.schedule import IRREGULAR_CAP, inserted_delays, served_range
from haptic_wall.controller.guard.types import Reason
from haptic_wall.controller.guard.work import Work

_OLDER = 1.1
"""Ratio of the mean delays of two ages that are decided, where not every age is [1]"""


def decide_bins(
    request: Request,
    settings: GuardSettings,
    situation: Situation,
    steps: int,
    ages_ns: Sequence[int],
    intervals_ns: Sequence[int],
    work: Work | None = None,
) -> list[Decision]:
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
        Interval by interval one decision for each age; last, with its reason, that for all older
        ages and longer intervals: no wall, but in mode ``off``.

    Raises:
        ValueError: As for ``decide``.
    """
    work = Work() if work is None else work
    found = [
        decision
        for index in range(len(intervals_ns))
        for decision in decide_bin(
            request, settings, situation, steps, ages_ns, intervals_ns, index, work
        )
    ]
    return [*found, _beyond(found[-1], settings, ages_ns, intervals_ns)]


def _beyond(
    last: Decision, settings: GuardSettings, ages_ns: Sequence[int], intervals_ns: Sequence[int]
) -> Decision:
    """Return the decision for what is older or longer than every bin."""
    if settings.mode == "off":
        return last
    text = (
        f"the wall fades out: samples are older than {ms(ages_ns[-1] * 1e-9)}, or more than"
        f" {intervals_ns[-1] / intervals_ns[0]:g} periods pass between readings"
    )
    return replace(last, stiffness=0.0, damping=0.0, binding=None, reasons=(Reason(text),))


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

    ``index`` counts the bins interval by interval, one for each age, and last what is beyond.
    """
    at, age = divmod(index, len(ages_ns))
    if at == len(intervals_ns):
        bins = (steps, ages_ns, intervals_ns)
        last = explained(request, settings, situation, *bins, index - 1, work)
        return _beyond(last, settings, ages_ns, intervals_ns)
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
    before = 0.5 * situation.period + inserted + situation.belief.delay.high
    some: list[int] = []
    for age in reversed(ages_ns):
        if not some or (before + some[-1] * 1e-9) > _OLDER * (before + age * 1e-9):
            some.append(age)
    return some[::-1]
