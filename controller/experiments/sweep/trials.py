"""The trials of one kick at one point: what they tell of the limit, and what to try next."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from haptic_wall.controller.experiments.sweep.growth_fit import Balance, Trial, balance

_FIRST = (0.6, 0.8, 1.0, 1.25)
_STIFFER = (1.2, 1.5, 1.9, 2.5)
_SOFTER = (0.3, 0.5, 0.7, 0.85)
_BETWEEN = (0.05, 0.35, 0.65, 0.95)
_AROUND = (-1.0, -0.4, 0.4, 1.0)
_COARSE, _FINE = 0.12, 0.04
"""Half widths of a batch around an estimate, in the logarithm of the stiffness"""
_CLOSE = 0.03
"""Relative standard error of an estimate from which trials are made close around it"""
_MOST_FINE = 4
_NARROW, _WIDE = 1.1, 1.5
"""Ratio of the ends of a bracket at which a search without a fit ends, and that is a result"""
_VAGUE, _BESIDE = 0.25, 1.25
"""Largest relative standard error of an estimate, and its largest factor beyond the trials"""


@dataclass(slots=True)
class Trials:
    """Trials of any stiffness, released at about one kick."""

    kick: float
    """[rad]"""
    made: list[Trial] = field(default_factory=list)

    @property
    def died(self) -> list[float]:
        """Return the stiffnesses at which motion decayed [N·m/rad]."""
        return [trial.stiffness for trial in self.made if not trial.grew]

    @property
    def grew(self) -> list[float]:
        """Return the stiffnesses at which it grew [N·m/rad]."""
        return [trial.stiffness for trial in self.made if trial.grew]

    @property
    def usable(self) -> int:
        """Return the number of trials with half-cycles to fit."""
        return sum(trial.growth.log_ratio.size > 0 for trial in self.made)

    def bracket(self) -> tuple[float, float] | None:
        """Return the stiffest that died below all that grew, and the softest that grew."""
        grew = min(self.grew, default=0.0)
        died = [k for k in self.died if k < grew]
        return (max(died), grew) if died else None

    @property
    def is_narrow(self) -> bool:
        """Whether a bracket is so narrow that more trials without a fit tell no more."""
        between = self.bracket()
        return between is not None and between[1] < _NARROW * between[0]

    def range(self) -> tuple[float, float] | None:
        """Return a bracket that is a result, outcomes that contradict it included; None: none."""
        between = self.bracket()
        if between is None:
            return None
        low, high = between[0], max(between[1], *self.died)
        return (low, high) if high < _WIDE * low else None

    def estimate(self) -> Balance | None:
        """Return the balance; None: the trials do not tell it."""
        if not self.grew or not self.died:
            return None
        # Near the limit a decaying trial may be stiffer than a growing one.
        middles = np.median(sorted(self.died)[-3:]) * np.median(sorted(self.grew)[:3])
        found = balance(self.made, self.kick, math.sqrt(float(middles)))
        if found is None or found.uncertainty > _VAGUE * found.stiffness:
            return None  # as where torque fades with the speed, and growth ends early
        beside = found.low / _BESIDE <= found.stiffness <= _BESIDE * found.high
        return found if beside else None

    def following(self, first: float, highest: float) -> list[float]:
        """Return stiffnesses toward the missing side of the bracket, or inside it [N·m/rad].

        Args:
            first: Where to begin.
            highest: Stiffest that may be tried.
        """
        grew, died = self.grew, self.died
        if not self.made:
            first = min(first, highest / _FIRST[-2])
            return [first * factor for factor in _FIRST]
        if not grew:
            stuck = max(died) > 0.999 * highest
            return [] if stuck else [min(max(died) * factor, highest) for factor in _STIFFER]
        if not died:
            return [min(grew) * factor for factor in _SOFTER]
        ends = sorted([min(grew), max([k for k in died if k < min(grew)], default=min(died))])
        ratio = max(ends[1] / ends[0], 1.02)
        return [ends[0] * ratio**share for share in _BETWEEN]


def is_close(found: Balance | None) -> bool:
    """Whether the next trials are made close around an estimate."""
    return found is not None and found.uncertainty < _CLOSE * found.stiffness


def around(found: Balance) -> list[float]:
    """Return stiffnesses around an estimate [N·m/rad]."""
    half = _FINE if is_close(found) else _COARSE
    return [found.stiffness * math.exp(half * x) for x in _AROUND]


def is_enough(found: Balance, fine: int, tolerance: float) -> bool:
    """Whether an estimate needs no more trials, after so many batches close around it."""
    if fine == 0 or not found.low <= found.stiffness <= found.high:
        return False
    return found.uncertainty <= tolerance * found.stiffness or fine >= _MOST_FINE
