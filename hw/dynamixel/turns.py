"""In which order servos on one bus are asked: who answers first, then by turns who does not.

In a chain of answers one that is missing keeps those behind it from being heard. Of several that do
not answer another is asked first each time, or those behind it would never be heard again.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import Final

_GONE: Final = 3
"""Readings lost in a row after which a servo is not waited for as long"""


class Turns:
    """Who has been heard lately.

    Args:
        ids: Of the servos, in the usual order.
    """

    def __init__(self, ids: Sequence[int]) -> None:
        self._ids = tuple(ids)
        self._unheard = dict.fromkeys(ids, 0)
        """Readings lost in a row, by its own fault"""
        self.all_heard = True
        """None stays away, so they are asked in the usual order"""

    def order(self, number: int) -> tuple[int, ...]:
        """The order for the request of this number."""
        silent = [id_ for id_ in self._ids if self._unheard[id_]]
        if not silent:
            return self._ids
        turn = number % len(silent)
        heard = (id_ for id_ in self._ids if not self._unheard[id_])
        return (*heard, *silent[turn:], *silent[:turn])

    def expected(self, ids: Sequence[int]) -> list[int]:
        """Those worth waiting for."""
        return [id_ for id_ in ids if self._unheard[id_] < _GONE]

    def heard(self, order: Sequence[int], found: Container[int], *, chained: bool) -> None:
        """Note who has answered; behind the first one missing in a chain nobody could."""
        for id_ in order:
            if id_ in found:
                self._unheard[id_] = 0
                continue
            self._unheard[id_] += 1
            if chained:
                break
        self.all_heard = not any(self._unheard.values())
