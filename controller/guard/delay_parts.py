"""Parts of a delay: which one is the largest, and how short that one might be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

WIRE, ADAPTER, HOLD, SAMPLE_AGE = "wire", "adapter", "hold", "sample_age"
"""Parts of the delay that are known here by name."""
SHORT_TIMER = 1e-3
"""The shortest latency timer of common USB adapters that is safe to set [s]."""


@dataclass(frozen=True, slots=True)
class DelayParts:
    """Parts of the total delay."""

    period: float
    """[s]; half of it, the hold, counts as delay"""
    named: Mapping[str, float]
    """The parts of t_d by name, each >= 0 [s]"""

    @property
    def delay(self) -> float:
        """t_d: all but the hold [s]."""
        return sum(self.named.values())

    @property
    def total(self) -> float:
        """Half a period for the hold, and t_d: what the damping is divided by [s]."""
        return self.period / 2 + self.delay

    def sizes(self) -> dict[str, float]:
        """Each part and the hold by name, largest first [s]."""
        sizes = {**self.named, HOLD: self.period / 2}
        return dict(sorted(sizes.items(), key=lambda item: -item[1]))

    def largest(self) -> tuple[str, float]:
        """Name and size [s] of the largest part, the hold counted."""
        return next(iter(self.sizes().items()))

    def with_part(self, name: str, size: float) -> DelayParts:
        """The same with one part, or the hold, of another size [s]."""
        if name == HOLD:
            return replace(self, period=2 * size)
        return replace(self, named={**self.named, name: size})


def shorter(parts: DelayParts, slow_replies: bool) -> float:
    """How much of its largest part a delay might do with [s].

    Half, of most; of a sample's age, where replies take several periods, a period and
    ``SHORT_TIMER``: the age at most where the adapter has that one.

    Args:
        parts: The delay.
        slow_replies: Replies take several periods.
    """
    name, size = parts.largest()
    if slow_replies and name == SAMPLE_AGE:
        return min(size / 2, parts.period + SHORT_TIMER)
    return size / 2


def ms(seconds: float) -> str:
    """A time of this size as text: in milliseconds, three digits, nothing below a microsecond."""
    return f"{round(1e3 * seconds, 3):.3g} ms"
