"""A tuning whose numbers keep the range in which each comparison with them has the same answer.

A run with such a tuning tells how far a number may be changed with no effect on that run: it has
the same rows for each value in the range. So a study need not run it again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace

from haptic_wall.controller.detector.tuning import TUNING, Tuning

UNTRACKED = {
    "backstop.loss_half_cycles",
    "belief.least_counts",
    "belief.sustained",
    "belief.bounces",
    "recording.wall_samples",
}
"""Numbers of which a logarithm is taken or that are lengths: a plain number is needed"""


@dataclass(slots=True)
class Asked:
    """Range of a number in which a run stays the same, without its ends."""

    low: float = -math.inf
    high: float = math.inf
    computed: bool = False
    """It entered the run by more than comparisons: any other value may change the run"""

    def allows(self, value: object) -> bool:
        """Whether the run stays the same with this value."""
        if self.computed or not isinstance(value, int | float):
            return False
        return self.low < value < self.high

    @property
    def used(self) -> bool:
        """Whether the run asked for the number at all."""
        return self.computed or self.low > -math.inf or self.high < math.inf


class _Number(float):
    """A number times a scale that notes what it is compared to."""

    __slots__ = ("asked", "scale")
    asked: Asked
    scale: float

    @classmethod
    def of(cls, value: float, asked: Asked, scale: float = 1.0) -> _Number:
        made = cls(value)
        made.asked, made.scale = asked, scale
        return made

    def _compared(self, other: object, *, less: bool, same: bool) -> bool:
        """Answer ``self < other`` or ``self > other``, and note how far the answer holds."""
        mine = float(self)
        if isinstance(other, _Number):
            self.asked.computed = other.asked.computed = True
            other = float(other)
        assert isinstance(other, int | float)
        answer = (mine < other if less else mine > other) or (same and mine == other)
        if self.scale == 0.0:
            self.asked.computed = True
        elif not math.isnan(other):
            end = other / self.scale
            below = (less == answer) == (self.scale > 0.0)
            if below:
                self.asked.high = min(self.asked.high, end)
            else:
                self.asked.low = max(self.asked.low, end)
        return answer

    def __lt__(self, other: object) -> bool:
        return self._compared(other, less=True, same=False)

    def __le__(self, other: object) -> bool:
        return self._compared(other, less=True, same=True)

    def __gt__(self, other: object) -> bool:
        return self._compared(other, less=False, same=False)

    def __ge__(self, other: object) -> bool:
        return self._compared(other, less=False, same=True)

    def __mul__(self, other: float) -> float:
        if isinstance(other, _Number):
            other.asked.computed = self.asked.computed = True
            return float(self) * float(other)
        return _Number.of(float(self) * other, self.asked, self.scale * other)

    __rmul__ = __mul__

    def __truediv__(self, other: float) -> float:
        if isinstance(other, _Number):
            other.asked.computed = self.asked.computed = True
            return float(self) / float(other)
        return _Number.of(float(self) / other, self.asked, self.scale / other)

    def __neg__(self) -> float:
        return _Number.of(-float(self), self.asked, -self.scale)

    __hash__ = float.__hash__


def _computing(name: str) -> Callable[..., object]:
    """An operation of ``float`` that notes that the number entered a computation."""
    plain: Callable[..., object] = getattr(float, name)

    def operation(self: _Number, *others: object) -> object:
        for each in (self, *others):
            if isinstance(each, _Number):
                each.asked.computed = True
        return plain(float(self), *(float(o) if isinstance(o, _Number) else o for o in others))

    return operation


for _name in (
    *("__add__", "__radd__", "__sub__", "__rsub__", "__rtruediv__", "__pow__", "__rpow__"),
    *("__mod__", "__rmod__", "__floordiv__", "__rfloordiv__", "__abs__", "__round__"),
    *("__eq__", "__ne__", "__bool__", "__int__", "__trunc__"),
):
    setattr(_Number, _name, _computing(_name))


def asked_tuning() -> tuple[Tuning, dict[str, Asked]]:
    """A tuning that behaves as ``TUNING`` does, and what it notes of each number by its name."""
    notes: dict[str, Asked] = {}
    groups = {}
    for group in fields(TUNING):
        numbers = getattr(TUNING, group.name)
        changed = {}
        for one in fields(numbers):
            name, value = f"{group.name}.{one.name}", getattr(numbers, one.name)
            if isinstance(value, tuple) or name in UNTRACKED:
                notes[name] = Asked(computed=True)
            else:
                notes[name] = Asked()
                changed[one.name] = _Number.of(value, notes[name])
        groups[group.name] = replace(numbers, **changed)
    return replace(TUNING, **groups), notes
