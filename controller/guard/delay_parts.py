"""Splits a delay into named parts, and finds the largest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

HOLD, SAMPLE_AGE = "hold", "sample_age"
"""Names of the delay's parts."""


@dataclass(frozen=True, slots=True)
class DelayParts:
    """The total delay as named parts."""

    period: float
    """[s]; half of it, the zero-order hold, counts as delay"""
    named: Mapping[str, float]
    """The parts of t_d by name, each >= 0 [s]"""

    @property
    def delay(self) -> float:
        """Return t_d, the delay without the hold [s]."""
        return sum(self.named.values())

    @property
    def total(self) -> float:
        """Return t_d and half a period for the hold [s]: the divisor of the linear limit."""
        return self.period / 2 + self.delay

    def sizes(self) -> dict[str, float]:
        """Return each part and the hold by name, largest first [s]."""
        sizes = {**self.named, HOLD: self.period / 2}
        return dict(sorted(sizes.items(), key=lambda item: -item[1]))

    def largest(self) -> tuple[str, float]:
        """Return name and size [s] of the largest part, the hold included."""
        return next(iter(self.sizes().items()))


def ms(seconds: float) -> str:
    """Format a time in milliseconds, with three digits and no more than microseconds."""
    return f"{round(1e3 * seconds, 3):.3g} ms"
