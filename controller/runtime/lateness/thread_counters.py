"""Counters of Linux for the loop's thread and core: time, waiting, faults, switches, steal.

Reading costs some 10 to 20 µs when the caches are cold, so it is done after a late tick and now
and then in the slack before a sleep, never between a sample and its torque.
"""

from __future__ import annotations

import contextlib
import os
import resource
import time
from dataclasses import dataclass

_NS_PER_CLOCK_TICK = 1_000_000_000 // os.sysconf("SC_CLK_TCK")
_STAT_BYTES = 1 << 16
"""Enough of /proc/stat for the lines of some 600 cores"""
_STEAL = 8
"""Place of the steal in a core's line of /proc/stat, its name counted"""


@dataclass(frozen=True, slots=True)
class Counters:
    """Counts of a thread since it began, or their growth between two readings."""

    at_ns: int
    """When they were read, or the time between [ns]"""
    on_core_ns: int
    """Time on a core [ns]; where the kernel can tell, without what a host stole"""
    run_delay_ns: int
    """Time it could have run, but another had the core [ns]"""
    minor_faults: int
    """Pages that were mapped without reading"""
    major_faults: int
    """Pages that were read from a disk"""
    voluntary: int
    """Switches because it slept or waited"""
    involuntary: int
    """Switches because another one was put in its place"""

    def less(self, other: Counters, share: float = 1.0) -> Counters:
        """These without a share of others: what has grown since, or beyond what is usual."""
        return Counters(
            self.at_ns - round(share * other.at_ns),
            self.on_core_ns - round(share * other.on_core_ns),
            self.run_delay_ns - round(share * other.run_delay_ns),
            self.minor_faults - round(share * other.minor_faults),
            self.major_faults - round(share * other.major_faults),
            self.voluntary - round(share * other.voluntary),
            self.involuntary - round(share * other.involuntary),
        )


class CounterReader:
    """Reads the counters of the thread that makes it; the files stay open.

    Args:
        core: The core whose steal is read.

    Attributes:
        knows_run_delay: Whether the kernel tells how long the thread waited for a core; without
            it the run delay reads 0.
    """

    def __init__(self, core: int) -> None:
        self._line = f"\ncpu{core} ".encode()
        self._schedstat = _opened("/proc/thread-self/schedstat")
        self._stat = _opened("/proc/stat")
        if self._schedstat is not None and not _tells(self._schedstat):
            os.close(self._schedstat)
            self._schedstat = None
        self.knows_run_delay = self._schedstat is not None

    def close(self) -> None:
        """Let go of the files."""
        for descriptor in (self._schedstat, self._stat):
            if descriptor is not None:
                os.close(descriptor)
        self._schedstat = self._stat = None

    def read(self) -> Counters:
        """The thread's counters now."""
        usage = resource.getrusage(resource.RUSAGE_THREAD)
        if self._schedstat is None:
            on_core, waited = time.thread_time_ns(), 0
        else:
            on_core, waited, _ = map(int, os.pread(self._schedstat, 100, 0).split())
        return Counters(
            time.monotonic_ns(),
            on_core,
            waited,
            usage.ru_minflt,
            usage.ru_majflt,
            usage.ru_nvcsw,
            usage.ru_nivcsw,
        )

    def steal_ns(self) -> int | None:
        """Time a host took from the core since it was started [ns], in steps of mostly 10 ms.

        Returns:
            None where the kernel does not tell.
        """
        if self._stat is None:
            return None
        text = os.pread(self._stat, _STAT_BYTES, 0)
        begin = text.find(self._line)
        words = text[begin : text.find(b"\n", begin + 1)].split() if begin >= 0 else []
        return int(words[_STEAL]) * _NS_PER_CLOCK_TICK if len(words) > _STEAL else None


def _tells(schedstat: int) -> bool:
    """Whether a thread that has run has run by this file: without the accounting all are zero."""
    words = os.pread(schedstat, 100, 0).split()
    return len(words) == 3 and words[0] != b"0"


def _opened(path: str) -> int | None:
    with contextlib.suppress(OSError):
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    return None
