"""Hands a change to the loop in small pieces, one in a tick, so that no tick is long.

The socket between the process that computes changes and that of the loop keeps each piece whole.
A control word counts the pieces, so that a tick without one costs one comparison. Long lists are
taken apart: a piece holds some of their elements, and the last piece holds the rest of the
change, with its lists put in place.
"""

from __future__ import annotations

import io
import pickle
import socket
from typing import Any, Final, NamedTuple

from haptic_wall.controller.detector.tuning import TUNING
from haptic_wall.controller.guard.guard import Decision
from haptic_wall.controller.runtime.change import Change, KnownServo, SentDecision
from haptic_wall.controller.runtime.changeover import Obstacle
from haptic_wall.controller.runtime.telemetry import Word
from haptic_wall.hw.clock import ready

FLOATS: Final = 512
"""Numbers in a piece"""
DECISIONS: Final = 10
"""Decisions in a piece"""
_SHORT: Final = 32
"""Numbers of a list that is not taken apart: the fields of an object may be a list, too"""
MOST_BYTES: Final = 1 << 15
"""Longest piece: a socket takes several"""
_OFFERED, _WITHDRAWN = int(Word.OFFERED), int(Word.WITHDRAWN)


class _Pickler(pickle.Pickler):
    """Sends long lists and the detector's numbers by name."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self.lists: list[list[Any]] = []
        self._named: dict[int, int] = {}

    def persistent_id(self, obj: Any) -> Any:  # noqa: ANN401 - pickle's signature
        """Return the name of an object that is sent separately; None for any other object."""
        if obj is TUNING:
            return -1
        if type(obj) is not list or not obj or not _at_a_time(obj):
            return None
        if id(obj) not in self._named:
            self._named[id(obj)] = len(self.lists)
            self.lists.append(obj)
        return self._named[id(obj)]


class _Unpickler(pickle.Unpickler):
    """Finds objects that were sent separately, by their names."""

    def __init__(self, piece: bytes, lists: list[list[Any]]) -> None:
        super().__init__(io.BytesIO(piece))
        self._lists = lists

    def persistent_load(self, pid: Any) -> Any:  # noqa: ANN401 - pickle's signature
        """Return the object of a name."""
        return TUNING if pid == -1 else self._lists[pid]


def _at_a_time(whole: list[Any]) -> int:
    """Return how many elements of a list go into a piece; 0: it is never long."""
    first = whole[0]
    if isinstance(first, float):
        return FLOATS if len(whole) > _SHORT else 0
    if isinstance(first, str):
        return 1
    return DECISIONS if isinstance(first, Decision) else 0


def pieces_of(change: Change) -> list[bytes]:
    """Return a change in pieces, the last one of a kind of its own."""
    file = io.BytesIO()
    pickler = _Pickler(file)
    pickler.dump(change)
    pieces = []
    for number, whole in enumerate(pickler.lists):
        size = _at_a_time(whole)
        for start in range(0, len(whole), size):
            part = whole[start : start + size]
            kind = b"+"
            if isinstance(part[0], Decision):
                kind, part = b"d", [SentDecision.of(each).fields for each in part]
            pieces.append(kind + pickle.dumps((number, part), pickle.HIGHEST_PROTOCOL))
    pieces.append(b"." + file.getvalue())
    assert max(map(len, pieces)) <= MOST_BYTES
    return pieces


class Settled(NamedTuple):
    """The outcome of a change."""

    row: int
    """Sequence number of the first row with it; -1: it was not made"""
    bin: int
    """Index of the decision that it came into force with"""


class Offers:
    """The side of the process that computes changes.

    Args:
        peer: Socket to the loop's process.
        words: The control words.
    """

    def __init__(self, peer: socket.socket, words: memoryview[int]) -> None:
        self._peer = peer
        self._words = words

    def servo(self, wait_s: float) -> KnownServo | None:
        """Return the servo, once the loop's process has sent it; None: not within ``wait_s``."""
        if not ready([self._peer.fileno()], wait_s):
            return None
        sent = self._peer.recv(MOST_BYTES)
        if not sent:
            return None
        servo = pickle.loads(sent)
        assert isinstance(servo, KnownServo)
        return servo

    def send(self, change: Change) -> None:
        """Send a change; waits while the loop has many pieces to take.

        Raises:
            OSError: The loop's process has ended, or takes no pieces.
        """
        for piece in pieces_of(change):
            self._peer.send(piece)
            self._words[_OFFERED] += 1

    def withdraw(self, number: int) -> None:
        """Ask for the change not to be made any more; ``settled`` says whether it was too late."""
        self._words[_WITHDRAWN] = number

    def settled(self, number: int) -> Settled | None:
        """Return the outcome of a change; None: it still waits."""
        words = self._words
        if words[Word.SETTLED] < number:
            return None
        return Settled(words[Word.CHANGED_AT], words[Word.CHANGED_BIN])

    @property
    def obstacle(self) -> tuple[Obstacle, float]:
        """Return why the change at hand waits, and the size of that."""
        words = self._words
        return Obstacle(words[Word.OBSTACLE]), 1e-6 * words[Word.OBSTACLE_SIZE]


class Inbox:
    """The side of the loop's process.

    Args:
        peer: Socket to the process that computes changes; None: there is none.
        words: The control words.

    Attributes:
        change: The change at hand; None: none is complete.
        made: The last change that was made; None: none was.
        taken: Number of pieces taken, to be compared with ``Word.OFFERED``.
    """

    __slots__ = ("_lists", "_loaded", "_peer", "_words", "change", "made", "taken")

    def __init__(self, peer: socket.socket | None, words: memoryview[int]) -> None:
        self._peer = peer
        self._words = words
        self._lists: list[list[Any]] = []
        self._loaded: Change | None = None
        self.change: Change | None = None
        self.made: Change | None = None
        self.taken = words[_OFFERED]

    def tell(self, servo: KnownServo) -> None:
        """Send the facts of the servo to the other side, before the loop runs."""
        if self._peer is None:
            return
        try:
            self._peer.send(pickle.dumps(servo, pickle.HIGHEST_PROTOCOL))
        except OSError:  # the other side has ended: the wall stays as it is
            self._peer = None

    def take(self) -> None:
        """Take one piece, unless a change is at hand; never waits."""
        if self.change is not None or self._peer is None:
            return
        if self._loaded is not None:  # in a tick of its own
            self._loaded.complete()
            self.change, self._loaded = self._loaded, None
            self.taken += 1
            return
        try:
            piece = self._peer.recv(MOST_BYTES, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        except ConnectionError:
            piece = b""
        if not piece:  # the other side has ended
            self._peer = None
            return
        if piece[:1] == b".":
            change = _Unpickler(piece[1:], self._lists).load()
            self._lists = []
            assert isinstance(change, Change)
            self._loaded = change
            return
        self.taken += 1
        number, part = pickle.loads(piece[1:])
        if piece[:1] == b"d":
            part = [SentDecision(*fields) for fields in part]
        if number == len(self._lists):
            self._lists.append(part)
        else:
            self._lists[number].extend(part)

    def waits(self, obstacle: Obstacle, size: float) -> None:
        """Tell why the change at hand is not made in this tick."""
        words = self._words
        words[Word.OBSTACLE] = obstacle
        words[Word.OBSTACLE_SIZE] = round(min(abs(size), 1e9) * 1e6)

    def settle(self, row: int, index: int) -> None:
        """Tell the outcome of the change at hand, as ``Settled`` has it."""
        change, words = self.change, self._words
        assert change is not None
        if row >= 0:
            self.made = change
        self.change = None
        words[Word.CHANGED_AT], words[Word.CHANGED_BIN] = row, index
        words[Word.OBSTACLE] = Obstacle.NONE
        words[Word.SETTLED] = change.number  # last: the others belong to it
