"""Judges one run under chaos: torque, reason of its end, log, memory. Pure functions."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from statistics import median

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.emulated_bus.record import BusRow
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.hw.dynamixel.codec import Instruction
from haptic_wall.hw.dynamixel.tables import REGISTERS

AFTER_S = 2.0
"""A fault may still show so long after it was over [s]"""
_AT_ONCE_S = 0.05
"""The last frame before what struck at once came so long before it at most [s]"""
SETTLED_S = 60.0
"""From when on memory must be flat [s]"""
WINDOW_S = 60.0
"""Over which memory is averaged, at either end [s]"""
STOP_FRAMES = 8
"""Goals of start and stop at most, which belong to no tick"""
READ_LATE_S = 0.1
"""By which an emulator that did not come to run may note a frame late [s]"""
_TORQUE_ENABLE = REGISTERS["torque_enable"].address
_GOAL_CURRENT = REGISTERS["goal_current"].address
_STATE_S = 2e-3
"""Two records of the state: torque that outlives its time by less has not [s]"""
_CYCLES = 100
"""Goals after which a run has begun for good; the start-up's probe has fewer"""


@dataclass(frozen=True, slots=True)
class Injected:
    """A fault that was injected into a run."""

    name: str
    from_s: float
    until_s: float
    """When what it did was over, on the monotonic clock [s]"""
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Stall:
    """The machine itself stood still on one core: nothing there ran, not even at top priority."""

    from_s: float
    until_s: float


@dataclass(slots=True)
class Ending:
    """How the torque of a run ended, by the witness."""

    cut_s: float | None = None
    """When Torque Enable 0 arrived; None: it never did"""
    last_goal_s: float | None = None
    """When the last goal arrived that belongs to the run"""
    goals: int = 0
    """Goals that arrived, those of the start-up's probe among them"""
    goal_times: list[float] = field(default_factory=list)
    """Times of the goals [s]"""
    duplicates: int = 0
    """Instructions that the bus has doubled on request"""
    torque_until_s: float | None = None
    """When the torque last acted; None: it never did"""
    offences: list[str] = field(default_factory=list)
    """Torque, or orders to make torque, behind the cut"""
    ended_s: float = 0.0
    """End of the record"""


def ending(rows: Iterable[BusRow], watchdog_s: float) -> Ending:
    """Find in a record when the torque was cut, and whether any torque came after it.

    Until Torque Enable 0 has arrived, the servo's Bus Watchdog must end the torque: no torque may
    act later than ``watchdog_s`` after the last frame. A watchdog that has tripped at zero torque
    may be armed again, so that torque after the next frame is allowed. The start-up is not judged,
    because there the watchdog is not always armed.

    Args:
        rows: Rows of the record, in order.
        watchdog_s: Setting of the Bus Watchdog [s].
    """
    found = Ending()
    armed_until_s, late_s = inf, 0.0
    for row in rows:
        found.ended_s = row.time_s
        if row.torque_nm != 0.0 and found.cut_s is None:
            late_s = max(late_s, row.time_s - armed_until_s)
        if row.event == "rx":
            armed_until_s = row.time_s + watchdog_s
            _take_frame(found, row)
            if found.goals < _CYCLES:
                late_s = 0.0
        elif row.event == "fault" and row.fault == "duplicate" and row.instruction != 85:
            found.duplicates += 1
        if row.torque_nm != 0.0:
            found.torque_until_s = row.time_s
            if found.cut_s is not None and row.event == "state":
                found.offences.append(
                    f"{row.torque_nm:.3g} N·m {1e3 * (row.time_s - found.cut_s):.1f} ms after the"
                    " cut"
                )
    if late_s > _STATE_S:
        found.offences.append(
            f"torque {1e3 * late_s:.1f} ms after the Bus Watchdog should have ended it"
        )
    return found


def _take_frame(found: Ending, row: BusRow) -> None:
    goal = _goal(row)
    if goal is not None:
        found.goals += 1
        found.goal_times.append(row.time_s)
        found.last_goal_s = row.time_s
        if found.cut_s is not None and goal:
            found.offences.append(f"a goal of {goal} was sent after the cut")
    enable = _written(row, _TORQUE_ENABLE)
    if enable is None or found.goals < _CYCLES:
        return
    if enable[0]:
        if found.cut_s is not None:
            found.offences.append("torque was switched on again after the cut")
    elif found.cut_s is None and row.error in (None, 0):
        found.cut_s = row.time_s


def _goal(row: BusRow) -> int | None:
    """The goal current that a frame carries [units]; None: it carries none."""
    if row.instruction == Instruction.SYNC_WRITE and row.error in (None, 0):
        head, data = row.params[:2], row.params[5:7]
        if int.from_bytes(head, "little") == _GOAL_CURRENT:
            return int.from_bytes(data, "little", signed=True)
    data = _written(row, _GOAL_CURRENT) or b""
    return int.from_bytes(data, "little", signed=True) if data else None


def _written(row: BusRow, address: int) -> bytes | None:
    """Value that a plain write puts at an address; None: it writes nothing there."""
    if row.instruction != Instruction.WRITE or row.error not in (None, 0):
        return None
    if int.from_bytes(row.params[:2], "little") != address or len(row.params) < 3:
        return None
    return row.params[2:]


def explanation(
    reason: str,
    stopped_s: float,
    injected: Sequence[Injected],
    may_end: Mapping[str, frozenset[str]],
) -> str | None:
    """The name of the latest fault that explains the end of a run; None: none does.

    Args:
        reason: The stop reason.
        stopped_s: When the loop last spoke, on the monotonic clock [s].
        injected: The faults at this run.
        may_end: The stop reasons that each fault may cause.
    """
    for fault in sorted(injected, key=lambda fault: -fault.from_s):
        near = fault.from_s - _AT_ONCE_S <= stopped_s <= fault.until_s + AFTER_S
        if near and reason in may_end[fault.name]:
            return fault.name
    return None


def stalled(reason: str, stopped_s: float, stalls: Sequence[Stall], least_s: float) -> bool:
    """Whether a stall that was seen explains the end of a run.

    Args:
        reason: The stop reason.
        stopped_s: When the loop last spoke, on the monotonic clock [s].
        stalls: The observed stalls.
        least_s: Shorter stalls explain nothing [s].
    """
    return reason in STALLED and any(
        stall.until_s - stall.from_s >= least_s
        and stall.from_s - _AT_ONCE_S <= stopped_s <= stall.until_s + AFTER_S
        for stall in stalls
    )


MACHINE = "the machine stood still"
STRANGERS = "others ran at real-time priority"
REFUSED = "refused to start, and said why"
STALLED: frozenset[str] = frozenset(
    {Trip.LOSSES_IN_ROW, Trip.LOSS_RATE, Trip.TORQUE_LOST, Trip.LOOP_HUNG}
)
"""Stop reasons of a loop or a bus that does not get to run"""


def gaps(seq: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Where rows are missing or out of order in a log.

    Args:
        seq: Sequence numbers of the rows, shape (n,).

    Returns:
        The number that was expected, and how many are missing there (below 0: it goes back).
    """
    if seq.size == 0:
        return []
    expected = np.concatenate([[0], seq[:-1] + 1])
    wrong = np.flatnonzero(seq != expected)
    return [(int(expected[i]), int(seq[i] - expected[i])) for i in wrong]


def missing_at_end(goal_times: Sequence[float], last_row_s: float) -> int:
    """Goals that the witness has seen well after the last row of a log, but for those of the stop.

    Args:
        goal_times: When goals arrived [s].
        last_row_s: When the tick of the last row woke [s].
    """
    after = len(goal_times) - int(np.searchsorted(goal_times, last_row_s + READ_LATE_S))
    return max(0, after - STOP_FRAMES)


def growth_mb(samples: Sequence[tuple[float, float]]) -> float | None:
    """By how much a process has grown [MB]; None: it was not watched for long enough.

    Args:
        samples: Samples of one process: time since it was first seen [s], resident memory [MB].
    """
    settled = [(t, size) for t, size in samples if t >= SETTLED_S]
    if not settled or settled[-1][0] - settled[0][0] < 2 * WINDOW_S:
        return None
    begin, end = settled[0][0] + WINDOW_S, settled[-1][0] - WINDOW_S
    first = median(size for t, size in settled if t <= begin)
    return median(size for t, size in settled if t >= end) - first
