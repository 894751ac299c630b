"""Rows and control words in shared memory: one writer, any number of readers, no locks.

The memory is an anonymous file (memfd) whose descriptor is passed on to child processes: it
disappears with the last of them, however they end. The first page holds control words, the rest a
ring of ticks with one row an axis. A tick is complete before ``HEAD`` counts it. An overtaken
reader notices it by ``HEAD``; readers of the rows notice it later by the gap in the sequence
numbers.
"""

from __future__ import annotations

import mmap
import os
import struct
from enum import IntEnum
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from haptic_wall.hw import elastic

INT_FIELDS = (
    "seq",
    "deadline_ns",
    "lateness_ns",
    "work_ns",
    "bus_ns",
    "sampled_ns",
    "age_ns",
    "outcome",
    "missed",
    "flags",
    "phase",
    "oscillation",
)
FLOAT_FIELDS = (
    "position",
    "velocity",
    "wall_torque",
    "torque",
    "stiffness",
    "damping",
    "delay_s",
    "measured_torque",
    "held_torque",
)
ROW = np.dtype([(name, "<i8") for name in INT_FIELDS] + [(name, "<f8") for name in FLOAT_FIELDS])
"""One tick of an axis: times [ns]; position [rad], velocity [rad/s], torques [N·m], commanded
stiffness [N·m/rad] and damping with the injected one [N·m·s/rad], the total delay that the guard
uses [s].

``seq`` counts the ticks. ``lateness_ns`` is from the deadline to the wake-up, ``sampled_ns`` 0
while no position is known, ``age_ns`` the age of the sample when its torque was sent. ``work_ns``
and ``bus_ns`` are those of the tick before, so that they include the writing of its row.
``outcome`` is an ``haptic_wall.hw.servo.Outcome``, ``missed`` the periods skipped before this tick,
``flags`` the sum of ``FLAG_...``, ``phase`` that of a program (-1 before it begins; 0 without one),
``oscillation`` the detector's state. ``wall_torque`` is the law's before the delay, ``torque`` the
one sent, ``measured_torque`` the servo's (NaN: it gives none), ``held_torque`` the part of the
law's that holds a load while the wall is softer."""

FLAG_SATURATED = 1
"""The wall's torque was limited."""
FLAG_CONTACT = 2
"""The position is inside the wall."""
FLAG_WARM_UP = 4
"""The wall is not on yet: torque is zero while the delay is measured."""
FLAG_OFF = 8
"""The wall is off during a run: the dead man was released, or the spring is loaded."""
FLAG_RAISED = 16
"""The return to the full wall was requested."""
FLAG_CHANGED = 32
"""From this tick on a change of the running wall is in force."""
FLAG_ALARM = 64
"""The alarm of an oscillation holds."""
FLAG_PROBED = 128
"""The wall is softer, to probe a motion of this or another axis."""
FLAG_REDUCED = 256
"""The wall is softer since an alarm, or has not yet returned from a probe or an alarm."""


_ROW_STRUCT = struct.Struct(f"<{len(INT_FIELDS)}q{len(FLOAT_FIELDS)}d")
_PACK, _ROW_BYTES = _ROW_STRUCT.pack_into, _ROW_STRUCT.size
_PAGE = 4096
_NAME = "haptic-wall-telemetry"
CAPACITY = 1 << 16
"""Ticks in the ring: a minute at 1 kHz"""
HALF_BYTES = 1 << 19
"""Longest change of a running wall"""
NO_DEAD_MAN = (1 << 63) - 1
"""Value of ``Word.HELD_NS`` without a dead man [ns]"""


class Word(IntEnum):
    """Indices of the control words; each has one writer, named."""

    HEAD = 0
    """Ticks written (loop)."""
    HEARTBEAT_NS = 1
    """Time of the loop's last tick (loop)."""
    STATE = 2
    """A ``LoopState`` (loop)."""
    STOP = 3
    """Not 0: end the run with torque off (supervisor)."""
    CUT = 4
    """Not 0: the supervisor has taken the bus; the loop must never write again (supervisor)."""
    TAIL = 5
    """Sequence number after the last recorded tick (recorder)."""
    FINISHED = 6
    """Not 0: no more rows will come (supervisor)."""
    TICKS = 7
    """Ticks executed (loop)."""
    MISSED = 8
    """Whole periods skipped (loop)."""
    RAISE = 9
    """Number of requests to return to the full wall (supervisor)."""
    LACKING = 10
    """Ticks before ``TAIL`` that the log lacks (recorder)."""
    HELD_NS = 11
    """Until when the dead man counts as held [ns]; far in the future without one (loop; door)."""
    LOG_FILE = 12
    """Identity of the log's file; 0: none was begun (recorder)."""
    OFFERED = 13
    """Number of the last change offered to the loop (door)."""
    WITHDRAWN = 14
    """Number of the last change that must not be made any more (door)."""
    SETTLED = 15
    """Number of the last change that was made or dropped (loop)."""
    CHANGED_AT = 16
    """Sequence number of the first tick with that change; -1: it was dropped (loop)."""
    CHANGED_BIN = 17
    """Index of the decision that it came into force with (loop)."""
    OBSTACLE = 18
    """An ``Obstacle``: why the change at hand waits (loop)."""
    OBSTACLE_SIZE = 19
    """Its size, in millionths (loop)."""
    BEGAN_NS = 20
    """The first deadline [ns]; 0: the loop does not run yet (loop)."""
    SUPPLY_MV = 21
    """Supply of the servo, of several the hottest one [mV]; 0: not known (loop)."""
    TEMPERATURE_MC = 22
    """Its temperature [m°C], known with the supply (loop)."""
    STOP_AXIS = 23
    """Number of the axis that ended the run, from 1; 0: none did (loop)."""
    REASON = 24
    """Number of the stop reason in ``safety.REASONS``, from 1; 0: the loop goes on (loop)."""
    OFFSET_NS = elastic.PLACE + elastic.OFFSET
    """Time that the loop has taken out of its clock [ns]; see ``hw.elastic`` (loop)."""
    WAITED_NS = elastic.PLACE + elastic.WAITED
    """Part of it in which the loop waited for the emulated bus [ns] (loop)."""
    COUPLED = elastic.PLACE + elastic.COUPLED
    """Not 0: loop and emulated bus wait for each other (loop, supervisor)."""


_HEAD = int(Word.HEAD)  # used in every tick: a plain number is twice as fast as an enum member


class LoopState(IntEnum):
    """State of the loop."""

    PREPARING = 0
    """It imports and computes, and has sent nothing to the servos."""
    STARTING = 1
    RUNNING = 2
    """On the grid, with a heartbeat."""
    TORQUE_OFF = 3
    """Torque off was commanded and read back."""
    TORQUE_UNKNOWN = 4
    """The loop is done, but torque off could not be read back."""
    STOPPING = 5
    """Off the grid; torque off is being sent and read back."""


class Telemetry:
    """The shared memory, from one process's side.

    Args:
        descriptor: Descriptor of a memory made by ``create``, possibly inherited.
        capacity: Number of ticks in the ring.
        axes: Number of axes.
        mapped: Map all pages now, which takes 10 ms, and none in a loop.

    Attributes:
        axes: See above.
        words: The control words.
        halves: Two places for changes of the running wall.
    """

    def __init__(
        self, descriptor: int, capacity: int = CAPACITY, *, axes: int = 1, mapped: bool = True
    ) -> None:
        self.descriptor, self.axes = descriptor, axes
        self._capacity, self._tick_bytes = capacity, axes * _ROW_BYTES
        flags = mmap.MAP_SHARED | (mmap.MAP_POPULATE if mapped else 0)
        self._map = mmap.mmap(descriptor, _size(capacity, axes), flags)
        self.words = memoryview(self._map)[:_PAGE].cast("q")
        halves = memoryview(self._map)[_PAGE + capacity * self._tick_bytes :]
        self.halves = halves[:HALF_BYTES], halves[HALF_BYTES:]
        # As plain numbers: NumPy copies rows of named fields field by field, ten times as slowly.
        numbers = capacity * self._tick_bytes // 8
        self._rows = np.frombuffer(self._map, np.int64, numbers, _PAGE).reshape(capacity, -1)
        self._head = int(self.words[Word.HEAD])
        self._at = _PAGE + self._head % capacity * self._tick_bytes
        self._end = self._at + self._tick_bytes

    @classmethod
    def create(cls, axes: int = 1) -> Self:
        """Return new, empty shared memory; the caller closes it.

        Its pages are not mapped yet: the process of a loop that inherits the memory maps it anew.
        """
        descriptor = os.memfd_create(_NAME)
        os.ftruncate(descriptor, _size(CAPACITY, axes))
        made = cls(descriptor, axes=axes, mapped=False)
        made.words[Word.HELD_NS] = NO_DEAD_MAN
        return made

    @classmethod
    def of(cls, pid: int, axes: int = 1) -> Self:
        """Return the memory that a running process of this user holds; the caller closes it.

        Raises:
            OSError: It holds none, or has ended.
        """
        for link in Path(f"/proc/{pid}/fd").iterdir():
            if _NAME in str(link.readlink()):
                return cls(os.open(link, os.O_RDWR), axes=axes, mapped=False)
        raise ProcessLookupError(f"process {pid} holds no {_NAME}")

    def close(self) -> None:
        """Close the descriptor; the memory stays mapped while it is in use."""
        os.close(self.descriptor)

    def write(self, *values: float) -> None:
        """Write the row of the next axis, the last of which ends the tick; only the loop does.

        Args:
            values: The fields of ``ROW`` after ``seq``, in order.
        """
        at, head = self._at, self._head
        _PACK(self._map, at, head, *values)
        at += _ROW_BYTES
        if at == self._end:
            self._head = self.words[_HEAD] = head = head + 1
            at = _PAGE + head % self._capacity * self._tick_bytes
            self._end = at + self._tick_bytes
        self._at = at

    def read(self, tail: int, most: int = CAPACITY) -> tuple[NDArray[np.void], int]:
        """Return copies of the rows from ``tail`` on, and the next tail.

        Args:
            tail: Sequence number of the first tick.
            most: Largest number of ticks to read.

        Returns:
            Rows, shape (ticks, axes), dtype ``ROW``, and the sequence number after the last. Where
            the writer has overtaken the reader, the rows start later than ``tail``: the gap shows
            in ``seq``.
        """
        head = int(self.words[Word.HEAD])
        start = max(tail, head - self._capacity + 1)
        head = min(head, start + most)
        first = start % self._capacity
        before_wrap = self._rows[first : first + head - start]
        behind_wrap = self._rows[: head - start - len(before_wrap)]
        rows = np.concatenate((before_wrap, behind_wrap)).view(ROW)
        # The writer may have overwritten rows meanwhile, wholly or in part.
        intact = int(self.words[Word.HEAD]) - self._capacity + 1
        return rows[max(0, intact - start) :], head


def _size(capacity: int, axes: int) -> int:
    """Return the size of a memory for so many ticks [bytes]."""
    return _PAGE + capacity * axes * _ROW_BYTES + 2 * HALF_BYTES
