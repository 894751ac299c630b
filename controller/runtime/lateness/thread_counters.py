"""Reads Linux's counters of the loop's thread and core: time, waiting, faults, switches, steal.

A reading takes 10 to 20 µs with cold caches. It is done after a late tick and periodically in the
idle window before a sleep, never between a sample and its torque.
"""

from __future__ import annotations

import contextlib
import os
import resource
import time
from dataclasses import dataclass

_NS_PER_CLOCK_TICK = 1_000_000_000 // os.sysconf("SC_CLK_TCK")
_STAT_BYTES = 1 << 16
"""Enough for the lines of some 600 cores in /proc/stat"""
_STEAL = 8
"""Index of the steal time in a core's line of /proc/stat, its name included"""


@dataclass(frozen=True, slots=True)
class Counters:
    """Counts of a thread since its start, or their growth between two readings."""

    at_ns: int
    """Time of the reading, or the time between two [ns]"""
    on_core_ns: int
    """Time on a core [ns]; without the host's steal where the kernel knows it"""
    run_delay_ns: int
    """Time in which it was ready, but another thread had the core [ns]"""
    minor_faults: int
    """Pages mapped without reading a disk"""
    major_faults: int
    """Pages read from a disk"""
    voluntary: int
    """Switches because it slept or waited"""
    involuntary: int
    """Switches because it was preempted"""

    def less(self, other: Counters, share: float = 1.0) -> Counters:
        """Return these less a fraction of others: the growth since, or beyond the usual."""
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
    """Reads the counters of the thread that creates it; the files stay open.

    Args:
        core: The core whose steal is read.

    Attributes:
        knows_run_delay: The kernel reports how long the thread waited for a core; otherwise the run
            delay reads 0.
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
        """Close the files."""
        for descriptor in (self._schedstat, self._stat):
            if descriptor is not None:
                os.close(descriptor)
        self._schedstat = self._stat = None

    def read(self) -> Counters:
        """Return the thread's counters now."""
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
        """Return the time a host took from the core since its start [ns], in steps of mostly 10 ms.

        Returns:
            None where the kernel does not report it.
        """
        if self._stat is None:
            return None
        text = os.pread(self._stat, _STAT_BYTES, 0)
        begin = text.find(self._line)
        words = text[begin : text.find(b"\n", begin + 1)].split() if begin >= 0 else []
        return int(words[_STEAL]) * _NS_PER_CLOCK_TICK if len(words) > _STEAL else None


def _tells(schedstat: int) -> bool:
    """Whether this file has counted a running thread: without the accounting all are zero."""
    words = os.pread(schedstat, 100, 0).split()
    return len(words) == 3 and words[0] != b"0"


def _opened(path: str) -> int | None:
    with contextlib.suppress(OSError):
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    return None
