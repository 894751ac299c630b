"""Rows and control words in shared memory: one writer, any number of readers, no locks.

The memory is an anonymous file (memfd) whose descriptor is passed on to child processes: it
vanishes with the last of them, whatever way they end. The first page holds control words, the
rest a ring of rows. A row is complete before ``HEAD`` counts it; a reader that is overtaken sees
it by ``HEAD``, and whoever reads the rows later by the gap in their sequence numbers.
"""

from __future__ import annotations

import mmap
import os
import struct
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

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
)
ROW = np.dtype([(name, "<i8") for name in INT_FIELDS] + [(name, "<f8") for name in FLOAT_FIELDS])
"""One tick: times [ns]; position [rad], velocity [rad/s], torques [N·m], commanded stiffness
[N·m/rad] and damping [N·m·s/rad], the total delay the guard counts with [s], the torque that the
servo measured (NaN: it gives none). ``work_ns`` and ``bus_ns`` are those of the tick before, so
that they include the writing of its row. ``phase`` is that of a program (0 without one),
``oscillation`` the detector's state."""

FLAG_SATURATED = 1
"""The torque limit cut what the wall asked for."""
FLAG_CONTACT = 2
"""The position is inside the wall."""
FLAG_WARM_UP = 4
"""The wall is not on yet: torque is zero while the delay is measured."""
FLAG_OFF = 8
"""The wall is off in the middle of a run: the dead man was let go, or the spring is loaded."""
FLAG_RAISED = 16
"""It was asked to go back to the full wall."""


@dataclass(slots=True)
class Row:
    """One tick, as the loop writes it; ``seq`` is the memory's. Reused from tick to tick."""

    deadline_ns: int = 0
    """The deadline served [ns]"""
    lateness_ns: int = 0
    """From it to when the loop woke [ns]"""
    work_ns: int = 0
    """Work of the tick before, the writing of its row included [ns]"""
    bus_ns: int = 0
    """Waiting for the bus in the tick before [ns]"""
    sampled_ns: int = 0
    """When the position was sampled [ns]; 0: none is known yet"""
    age_ns: int = 0
    """Age of the sample when its torque was sent [ns]"""
    outcome: int = 0
    """An ``haptic_wall.hw.servo.Outcome``"""
    missed: int = 0
    """Whole periods skipped before this tick [1]"""
    flags: int = 0
    """``FLAG_...``, added"""
    phase: int = 0
    """Of a program; 0 without one"""
    oscillation: int = 0
    """State of the detector"""
    position: float = 0.0
    """[rad]"""
    velocity: float = 0.0
    """Estimated [rad/s]"""
    wall_torque: float = 0.0
    """Of the law, before the delay [N·m]"""
    torque: float = 0.0
    """Sent [N·m]"""
    stiffness: float = 0.0
    """Commanded [N·m/rad]"""
    damping: float = 0.0
    """Commanded, with what is injected [N·m·s/rad]"""
    delay_s: float = 0.0
    """The total delay that the guard counts with [s]"""
    measured_torque: float = 0.0
    """[N·m]; NaN: the servo measures none"""


_ROW_STRUCT = struct.Struct(f"<{len(INT_FIELDS)}q{len(FLOAT_FIELDS)}d")
_PACK, _ROW_BYTES = _ROW_STRUCT.pack_into, _ROW_STRUCT.size
_PAGE = 4096
CAPACITY = 1 << 16
NO_DEAD_MAN = (1 << 63) - 1
"""What ``Word.HELD_NS`` holds where nobody has to hold anything [ns]"""


class Word(IntEnum):
    """Places of the control words; each has one writer, named."""

    HEAD = 0
    """Rows written (loop)."""
    HEARTBEAT_NS = 1
    """When the loop last lived (loop)."""
    STATE = 2
    """A ``State`` (loop)."""
    STOP = 3
    """Not 0: end the run with torque off (supervisor)."""
    CUT = 4
    """Not 0: the supervisor has taken the bus; never write again (supervisor)."""
    TAIL = 5
    """The row after the last that was recorded (recorder)."""
    FINISHED = 6
    """Not 0: no more rows will come (supervisor)."""
    TICKS = 7
    """Ticks executed (loop)."""
    MISSED = 8
    """Whole periods skipped (loop)."""
    RAISE = 9
    """How often it was asked to go back to the full wall (supervisor)."""
    LACKING = 10
    """Rows before ``TAIL`` that the log lacks (recorder)."""
    HELD_NS = 11
    """Until when the dead man counts as held [ns]; far ahead where there is none (watcher)."""
    LOG_FILE = 12
    """Identity of the log's file; 0: none was begun (recorder)."""


_HEAD = int(Word.HEAD)  # in every tick: a plain number is twice as quick as a member


class State(IntEnum):
    """Where the loop is."""

    STARTING = 0
    RUNNING = 1
    """On the grid; from here on there is a heartbeat."""
    TORQUE_OFF = 2
    """Torque off was commanded and read back."""
    TORQUE_UNKNOWN = 3
    """The loop is done, but torque off could not be read back."""
    STOPPING = 4
    """Off the grid; torque off is being sent and read back."""


class Telemetry:
    """The shared memory, from one process's side.

    Args:
        descriptor: Of a memory made by ``create``, possibly inherited.
        capacity: Rows that it holds.
    """

    def __init__(self, descriptor: int, capacity: int = CAPACITY) -> None:
        self.descriptor = descriptor
        self._capacity = capacity
        flags = mmap.MAP_SHARED | mmap.MAP_POPULATE  # not page by page as rows first come there
        self._map = mmap.mmap(descriptor, _PAGE + capacity * _ROW_BYTES, flags)
        self.words = memoryview(self._map)[:_PAGE].cast("q")
        # As plain numbers: rows of named fields are copied field by field, ten times as slowly.
        self._rows = np.frombuffer(self._map, np.int64, offset=_PAGE).reshape(capacity, -1)
        self._head = int(self.words[Word.HEAD])

    @classmethod
    def create(cls) -> Telemetry:
        """New, empty shared memory; to be closed."""
        descriptor = os.memfd_create("haptic-wall-telemetry")
        os.ftruncate(descriptor, _PAGE + CAPACITY * _ROW_BYTES)
        return cls(descriptor)._without_dead_man()

    def close(self) -> None:
        """Let go of the descriptor; what is mapped is there for as long as somebody holds it."""
        os.close(self.descriptor)

    @classmethod
    def scratch(cls) -> Telemetry:
        """Memory of this process alone, for a few rows that nobody reads."""
        return cls(-1, 8)._without_dead_man()

    def _without_dead_man(self) -> Telemetry:
        self.words[Word.HELD_NS] = NO_DEAD_MAN
        return self

    def write(self, row: Row) -> None:
        """Append one row; only the loop does."""
        head = self._head
        _PACK(
            self._map,
            _PAGE + head % self._capacity * _ROW_BYTES,
            head,
            row.deadline_ns,
            row.lateness_ns,
            row.work_ns,
            row.bus_ns,
            row.sampled_ns,
            row.age_ns,
            row.outcome,
            row.missed,
            row.flags,
            row.phase,
            row.oscillation,
            row.position,
            row.velocity,
            row.wall_torque,
            row.torque,
            row.stiffness,
            row.damping,
            row.delay_s,
            row.measured_torque,
        )
        self._head = self.words[_HEAD] = head + 1

    def read(self, tail: int, most: int = CAPACITY) -> tuple[NDArray[np.void], int]:
        """Copies of the rows from ``tail`` on, and the next tail.

        Args:
            tail: The sequence number to begin with.
            most: How many rows to read at most.

        Returns:
            Rows, shape (n,), dtype ``ROW``, and the sequence number that follows the last. Where
            the writer has overtaken the reader, the rows start later than ``tail``: the gap
            shows in ``seq``.
        """
        head = int(self.words[Word.HEAD])
        start = max(tail, head - self._capacity + 1)
        head = min(head, start + most)
        first = start % self._capacity
        before_wrap = self._rows[first : first + head - start]
        behind_wrap = self._rows[: head - start - len(before_wrap)]
        rows = np.concatenate((before_wrap, behind_wrap)).reshape(-1).view(ROW)
        # Rows that the writer has come to meanwhile may be overwritten, wholly or in part.
        intact = int(self.words[Word.HEAD]) - self._capacity + 1
        return rows[max(0, intact - start) :], head
