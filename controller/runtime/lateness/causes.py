"""Finds the likely cause of a late tick from counters of the kernel.

Linux does not report why a thread ran late. But the thread spent every microsecond between the
deadline and the end of the tick somewhere: asleep, waiting for the core, running on the core, or
waiting for the bus. The counters show where, and the largest fraction is the likely cause.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from haptic_wall.controller.runtime.lateness.thread_counters import Counters

_ENOUGH = 0.5
"""Fraction of the delay that a kind of waiting must make up to be its cause"""
_WORTH_SAYING = 0.1
"""Fraction of the delay below which a wait for the core is no evidence"""
_FAULT_NS = 5_000
"""Largest cost of a minor page fault [ns]: 0.5 µs on a quick machine, 5 µs on a virtual one"""


class Cause(StrEnum):
    """Cause of a late tick."""

    STOPPED = "the process was stopped"
    COLLECTION = "garbage collection"
    OTHER = "another process ran on the core"
    FAULTS = "page faults"
    LOST = "a reply was lost"
    BUS = "waited for the bus"
    HOST = "the host stole the core"
    KERNEL = "the kernel or the firmware held the core"
    WOKEN_LATE = "woken late by the kernel"
    BLOCKED = "the tick waited for something else than the bus"
    WORK = "the tick's own work"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Machine:
    """Properties of the machine that stay constant during a run."""

    virtual: bool
    """Whether this is a virtual machine, whose host can take the core"""
    real_time: bool
    """Whether the loop has a real-time scheduler"""
    shared: bool
    """Whether the machine has one core only, so that recorder and supervisor run on it too"""
    knows_run_delay: bool
    """Whether the kernel counts how long a thread waits for its core"""


@dataclass(frozen=True, slots=True)
class Late:
    """A late tick: the loop's own times, and the counters' growth."""

    asleep_ns: int
    """From the deadline to the end of the sleep [ns]; 0: the sleep ended in time"""
    held_ns: int
    """Time of spinning after the sleep, beyond the deadline [ns]"""
    work_ns: int
    """From there to the end of the tick, without waiting for the bus [ns]"""
    bus_ns: int
    """Waiting for the bus [ns]"""
    long_wait: bool
    """Whether the wait for the bus was longer than usual; otherwise it is no part of the delay"""
    lost: bool
    """Whether a reply did not come"""
    stopped: bool
    """Whether the process was stopped and continued (SIGCONT)"""
    collections_ns: int
    """Time in garbage collections [ns]"""
    beyond: Counters
    """Growth of the counters since the last reading, beyond the usual growth in that time"""
    steal_ns: int | None
    """Time the host took from the core since the last reading [ns]; None: not read"""

    @property
    def total_ns(self) -> int:
        """Return the time from the deadline, or the last tick's end, to this end [ns]."""
        return self.asleep_ns + self.held_ns + self.work_ns + self.bus_ns

    @property
    def delay_ns(self) -> int:
        """Return the avoidable part of ``total_ns`` [ns]; it includes the usual work."""
        return self.total_ns if self.long_wait else self.total_ns - self.bus_ns

    @property
    def awake_ns(self) -> int:
        """Return the time awake: spinning beyond the deadline, and work [ns]."""
        return self.held_ns + self.work_ns

    @property
    def on_core_ns(self) -> int:
        """Return the part of ``awake_ns`` that the loop ran on the core [ns]."""
        return min(max(self.beyond.on_core_ns, 0), self.awake_ns)

    @property
    def gone_ns(self) -> int:
        """Return the part of ``awake_ns`` that no process ran on the core [ns]."""
        return self.awake_ns - self.on_core_ns - max(self.beyond.run_delay_ns, 0)


def likely_cause(late: Late, machine: Machine) -> Cause:
    """Return the likely cause of a late tick: the kind of waiting that makes up most of its delay.

    A reading of the counters covers the time since the last reading, some 20 ms. The usual growth
    in that time is subtracted, which leaves an uncertainty of about 0.1 ms.

    Args:
        late: The tick.
        machine: The machine.
    """
    enough = _ENOUGH * late.delay_ns
    beyond = late.beyond
    if late.stopped:
        return Cause.STOPPED
    if late.collections_ns >= enough:
        return Cause.COLLECTION
    if beyond.run_delay_ns >= enough or (not machine.knows_run_delay and beyond.involuntary > 0):
        return Cause.OTHER
    if late.long_wait and late.bus_ns >= enough:
        return Cause.LOST if late.lost else Cause.BUS
    if beyond.major_faults > 0:
        return Cause.FAULTS
    if late.asleep_ns >= enough:  # no other thread had the core, but the sleep did not end
        stolen = late.steal_ns is not None and late.steal_ns >= _ENOUGH * late.asleep_ns
        return Cause.HOST if stolen else Cause.WOKEN_LATE
    if late.awake_ns >= enough and beyond.minor_faults * _FAULT_NS >= _ENOUGH * late.awake_ns:
        return Cause.FAULTS
    if late.gone_ns >= enough:
        # The number of bus waits varies: one more switch than usual is no evidence.
        if beyond.voluntary > (1 if late.bus_ns else 0):
            return Cause.BLOCKED
        return Cause.HOST if machine.virtual else Cause.KERNEL
    return Cause.WORK if late.on_core_ns >= enough else Cause.UNKNOWN


def evidence(cause: Cause, late: Late, machine: Machine) -> str:
    """Describe the evidence for a cause, with its figures.

    Args:
        cause: Cause from ``likely_cause``.
        late: The tick.
        machine: The machine.
    """
    awake = f"on the core for {_ms(late.on_core_ns)} of {_ms(late.awake_ns)}"
    timer = f"the timer came {_ms(late.asleep_ns)} late"
    match cause:
        case Cause.STOPPED:
            parts = ["continued by SIGCONT", _waited(late)]
        case Cause.COLLECTION:
            parts = [f"collections took {_ms(late.collections_ns)}"]
        case Cause.OTHER:
            parts = [_waited(late), _why_others(machine)]
        case Cause.LOST | Cause.BUS:
            parts = [f"waited {_ms(late.bus_ns)} for the reply", _waited(late)]
        case Cause.FAULTS:
            major, minor = late.beyond.major_faults, late.beyond.minor_faults
            parts = [f"{minor} minor and {major} major page faults"]
        case Cause.HOST if late.asleep_ns > late.awake_ns:
            parts = [timer, _stolen(late)]
        case Cause.WOKEN_LATE:
            host = "perhaps the host was busy" if machine.virtual else ""
            parts = [timer, "nothing else ran on the core", _stolen(late), host]
        case Cause.HOST:
            parts = [awake, "no other process had it", _stolen(late) if late.steal_ns else ""]
        case Cause.KERNEL:
            parts = [awake, "no other process had it: interrupts, or firmware"]
        case Cause.BLOCKED:
            parts = [awake, "it gave the core away: a lock, a file, a terminal"]
        case Cause.WORK:
            parts = [awake]
        case Cause.UNKNOWN:
            parts = [f"asleep {_ms(late.asleep_ns)}", awake, f"bus {_ms(late.bus_ns)}"]
    return "; ".join(part for part in parts if part)


def _waited(late: Late) -> str:
    words = []
    if late.beyond.run_delay_ns >= _WORTH_SAYING * late.total_ns:
        words.append(f"waited {_ms(late.beyond.run_delay_ns)} for the core")
    count = late.beyond.involuntary
    if count > 0:
        words.append(f"{count} involuntary switch{'es' if count > 1 else ''}")
    return ", ".join(words)


def _why_others(machine: Machine) -> str:
    if machine.shared:
        return "the recorder and the supervisor share the loop's only core"
    if machine.real_time:
        return "one of the loop's real-time priority or above"
    return "the loop has no real-time scheduler"


def _stolen(late: Late) -> str:
    return "" if late.steal_ns is None else f"steal {_ms(late.steal_ns)}"


def _ms(time_ns: float) -> str:
    return f"{time_ns * 1e-6:.3g} ms"
