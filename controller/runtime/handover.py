"""Hands a change to the loop through the shared memory, in one of two halves.

A control word says which change is offered; it lies in the half of its number's parity, so that
the one before is not overwritten while the loop may read it. A tick without a change costs one
comparison. The loop takes a change after its torque is sent.
"""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from typing import NamedTuple

from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.guard.belief import Bounded
from haptic_wall.controller.guard.schedule import GainTable
from haptic_wall.controller.laws.wall import Law
from haptic_wall.controller.runtime.changeover import Obstacle
from haptic_wall.controller.runtime.telemetry import LoopState, Telemetry, Word
from haptic_wall.hw.servo import Facts, Traffic

_OFFERED, _WITHDRAWN = int(Word.OFFERED), int(Word.WITHDRAWN)


@dataclass(frozen=True, slots=True)
class KnownServo:
    """What the guard knows of an opened servo; another process may have opened it."""

    facts: Facts
    traffic: Traffic | None
    """Of its bus; None: no reply travels"""
    lag: Bounded | None = None
    """The longest device delay that is believed of any servo on its bus, bounded below by the
    shortest one [s]; None: it is alone"""


@dataclass(slots=True)
class Change:
    """All data that the loop needs for a change; another process computes them."""

    number: int
    """Counts the changes of a run, from 1"""
    config: str
    """The axis' configuration with the change, as JSON; read after the run"""
    law: Law | None
    """New law, positioned without the start position; None: the same law with other gains"""
    watch: WatchSettings
    moved: bool
    """Whether law or position differ"""
    softer: bool
    """Whether the change is only a lower stiffness"""
    table: GainTable
    """The guard's decisions"""
    steps: int
    """Steps of the inserted delay [periods]"""
    axis: int = 0
    """Index of the axis"""
    placed: bool = False
    """Whether the start position was added to the law's position, where ``wall.reference`` says
    so"""


class Settled(NamedTuple):
    """The outcome of a change."""

    row: int
    """Sequence number of the first row with it; -1: it was not made"""
    bin: int
    """Index of the decision that it came into force with"""


def known_servos(telemetry: Telemetry) -> list[KnownServo] | None:
    """Return the servo of each axis while the loop runs; None: it does not."""
    if telemetry.words[Word.STATE] != LoopState.RUNNING:
        return None
    servos: list[KnownServo] = pickle.loads(telemetry.halves[0])
    return servos


def offer(telemetry: Telemetry, change: Change) -> None:
    """Offer a change to the loop; the one before is settled, or is given up.

    Raises:
        UserError: Its law has too many numbers for a running loop.
    """
    _put(telemetry.halves[change.number & 1], change)
    telemetry.words[_OFFERED] = change.number


def withdraw(words: memoryview[int], number: int) -> None:
    """Ask for a change not to be made any more; ``settled`` says whether it was too late."""
    words[_WITHDRAWN] = number


def settled(words: memoryview[int], number: int) -> Settled | None:
    """Return the outcome of a change; None: it still waits."""
    if words[Word.SETTLED] < number:
        return None
    return Settled(words[Word.CHANGED_AT], words[Word.CHANGED_BIN])


def obstacle(words: memoryview[int]) -> tuple[Obstacle, float]:
    """Return why the change at hand waits, and the size of that."""
    return Obstacle(words[Word.OBSTACLE]), 1e-6 * words[Word.OBSTACLE_SIZE]


class Inbox:
    """The side of the loop's process.

    Args:
        telemetry: The shared memory.

    Attributes:
        change: The change at hand; None: none is.
        taken: Number of the last change taken, to be compared with ``Word.OFFERED``.
    """

    def __init__(self, telemetry: Telemetry) -> None:
        self._halves = telemetry.halves
        self._words = telemetry.words
        self.change: Change | None = None
        self.taken = 0

    def tell(self, servos: list[KnownServo]) -> None:
        """Tell the other side the facts of the servos, before the loop runs."""
        _put(self._halves[0], servos)

    def take(self) -> Change | None:
        """Return the offered change; None: one is at hand."""
        if self.change is not None:
            return None
        number = self._words[_OFFERED]
        change = pickle.loads(self._halves[number & 1])
        assert isinstance(change, Change)
        self.change, self.taken = change, number
        return change

    def waits(self, obstacle: Obstacle, size: float) -> None:
        """Tell why the change at hand is not made in this tick."""
        words = self._words
        words[Word.OBSTACLE] = obstacle
        words[Word.OBSTACLE_SIZE] = round(min(abs(size), 1e9) * 1e6)

    def settle(self, row: int, index: int) -> None:
        """Tell the outcome of the change at hand, as ``Settled`` has it."""
        change, words = self.change, self._words
        assert change is not None
        self.change = None
        words[Word.CHANGED_AT], words[Word.CHANGED_BIN] = row, index
        words[Word.OBSTACLE] = Obstacle.NONE
        words[Word.SETTLED] = change.number  # last: the others belong to it


def _put(half: memoryview[int], what: Change | list[KnownServo]) -> None:
    """Write an object; a reader finds its end by itself."""
    data = pickle.dumps(what, pickle.HIGHEST_PROTOCOL)
    if len(data) > len(half):
        raise UserError(
            f"found a law of {len(data) >> 10} kB",
            field="wall.law",
            wanted=f"at most {len(half) >> 10} kB in a running wall",
            advice="give its profiles fewer rows, or start another run",
        )
    half[: len(data)] = memoryview(data)
