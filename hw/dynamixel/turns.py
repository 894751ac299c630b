"""Decides the order in which servos on one bus are requested: those that reply first.

In a chain of replies a missing servo silences those after it. Of several missing servos another one
is requested first each time, or those after it would never be heard again.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import Final

_GONE: Final = 3
"""Consecutive lost readings after which the wait for a servo is shorter"""


class Turns:
    """Tracks which servos have replied lately.

    Args:
        ids: Ids of the servos, in the usual order.
    """

    def __init__(self, ids: Sequence[int]) -> None:
        self._ids = tuple(ids)
        self._unheard = dict.fromkeys(ids, 0)
        """Consecutive lost readings by a servo's own fault"""
        self.all_heard = True
        """No servo is missing, so the usual order is used"""

    def order(self, number: int) -> tuple[int, ...]:
        """Return the order for the request of this number."""
        silent = [id_ for id_ in self._ids if self._unheard[id_]]
        if not silent:
            return self._ids
        turn = number % len(silent)
        heard = (id_ for id_ in self._ids if not self._unheard[id_])
        return (*heard, *silent[turn:], *silent[:turn])

    def expected(self, ids: Sequence[int]) -> list[int]:
        """Return the servos worth waiting for."""
        return [id_ for id_ in ids if self._unheard[id_] < _GONE]

    def heard(self, order: Sequence[int], found: Container[int], *, chained: bool) -> None:
        """Record which servos have replied; after the first missing one in a chain none could."""
        for id_ in order:
            if id_ in found:
                self._unheard[id_] = 0
                continue
            self._unheard[id_] += 1
            if chained:
                break
        self.all_heard = not any(self._unheard.values())
