"""Times the system calls that a loop makes on the bus, by wrapping them from outside."""

from __future__ import annotations

import os
import select
import statistics
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import SimpleNamespace
from typing import TypeVar
from unittest.mock import patch

from haptic_wall.controller.bench.bare_loop import GOAL_CURRENT_0
from haptic_wall.hw.dynamixel import serial_line

_LOOK = "look for late bytes"
Found = TypeVar("Found")


class Calls:
    """Times the system calls on the bus, those that wait excepted.

    Attributes:
        times_ns: Times of each kind of call [ns].
    """

    def __init__(self) -> None:
        self.times_ns: dict[str, list[int]] = defaultdict(list)
        self._os, self._select = os, select  # while listening, the names are those of others

    @contextmanager
    def listening(self, bare: str) -> Iterator[None]:
        """Time the calls of the line, and those of a bare loop, opened inside the block.

        Args:
            bare: Name of the module with the bare loop.
        """
        timed_os = SimpleNamespace(**vars(os) | {"write": self._write, "read": self._read})
        of_line = SimpleNamespace(**vars(select) | {"poll": self._timed_poll})  # its select waits
        of_bare = SimpleNamespace(**vars(select) | {"select": self._timed_select})
        with ExitStack() as stack:
            for module, timed_select in ((serial_line, of_line), (sys.modules[bare], of_bare)):
                stack.enter_context(patch.object(module, "os", timed_os))
                stack.enter_context(patch.object(module, "select", timed_select))
            yield

    def timed(self, kind: str, call: Callable[..., Found], *values: object) -> Found:
        """Call, and count the time."""
        began = time.monotonic_ns()
        found = call(*values)
        self.times_ns[kind].append(time.monotonic_ns() - began)
        return found

    def figures(self, ticks: int) -> dict[str, list[float]]:
        """Return the calls a tick and their median time [µs], of each kind.

        The time of timing is subtracted.
        """
        if not self.times_ns:
            return {}
        kept, self.times_ns = self.times_ns, defaultdict(list)
        for _ in range(1000):
            self.timed("nothing", _nothing)
        timing = statistics.median(self.times_ns.pop("nothing"))
        return {
            kind: [len(each) / ticks, 1e-3 * (statistics.median(each) - timing)]
            for kind, each in kept.items()
        }

    def _write(self, descriptor: int, data: bytes) -> int:
        kind = "write a goal" if len(data) == len(GOAL_CURRENT_0) else "write a request"
        return self.timed(kind, self._os.write, descriptor, data)

    def _read(self, descriptor: int, most: int) -> bytes:
        return self.timed("read a reply", self._os.read, descriptor, most)

    def _timed_select(
        self, read: list[int], write: list[int], error: list[int], timeout_s: float
    ) -> tuple[list[int], list[int], list[int]]:
        call = self._select.select
        if timeout_s > 0.0:
            return call(read, write, error, timeout_s)
        return self.timed(_LOOK, call, read, write, error, timeout_s)

    def _timed_poll(self) -> _Poll:
        return _Poll(self, self._select.poll())


class _Poll:
    """A poll object whose calls are timed."""

    def __init__(self, calls: Calls, poll: select.poll) -> None:
        self._calls = calls
        self.register = poll.register
        self._poll = poll.poll

    def poll(self, milliseconds: int) -> list[tuple[int, int]]:
        """Poll; see ``select.poll``."""
        return self._calls.timed(_LOOK, self._poll, milliseconds)


def _nothing() -> None:
    return None
