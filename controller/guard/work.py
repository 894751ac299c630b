"""Keeps what one asker had computed: a start asks for the same limits again and again."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any, TypeVar

T = TypeVar("T")

_MOST = {"scan": 192}
_MOST_OTHERS = 8192


class Work:
    """Results by what they were asked with; the oldest of a kind go when there are too many.

    A servo may report its torque limit only after its start, with torque on: its decisions must
    then not be computed anew.
    """

    def __init__(self) -> None:
        self._kinds: dict[Hashable, dict[Hashable, Any]] = {}

    def once(self, key: tuple[Hashable, ...], compute: Callable[[], T]) -> T:
        """Return the result for ``key``, whose first part is its kind."""
        if not self.knows(key):
            self.keep(key, compute())
        found: T = self._kinds[key[0]][key]
        return found

    def knows(self, key: tuple[Hashable, ...]) -> bool:
        """Whether there is a result for ``key``."""
        return key in self._kinds.get(key[0], {})

    def keep(self, key: tuple[Hashable, ...], result: object) -> None:
        """Keep a result for ``key``."""
        known = self._kinds.setdefault(key[0], {})
        if len(known) >= _MOST.get(str(key[0]), _MOST_OTHERS):
            del known[next(iter(known))]
        known[key] = result
