"""The kinds of pieces that a log consists of, and a sentence about each faulty one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_LONGEST_S: Final = 1e9
"""Longest plausible time of a run"""


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes that hold no intact block, or content that no run writes."""

    start: int
    """Offset in the file [bytes]"""
    size: int
    """[bytes]"""
    last: bool
    """Nothing follows: the end is missing, or is being written"""
    why: str | None = None
    """The reason, if more is known than that these bytes are no intact block"""


@dataclass(frozen=True, slots=True)
class Misplaced:
    """Omitted rows: they come after later ones, or twice."""

    rows: int
    twice: int
    """Number of omitted rows that came before"""


@dataclass(frozen=True, slots=True)
class Head:
    """The metadata of another log, which begins here: two files were joined."""

    metadata: dict[str, Any]


@dataclass(frozen=True, slots=True)
class End:
    """The run's end, as its own program wrote it."""

    ended: dict[str, Any]
    """``stop_reason`` and ``message`` are texts, or None; ``rows`` is a count, if present"""


@dataclass(frozen=True, slots=True)
class Event:
    """A requested change of the running wall, made or not."""

    change: dict[str, Any]
    """As in the report's ``changes``; ``fault_of_change`` finds nothing"""


Piece = NDArray[np.void] | Damage | Misplaced | Head | End | Event


def fault_of_change(change: object) -> str | None:
    """Return the implausible part of a change of the wall as a log tells it; None: there is none.

    What is missing counts as None, and only ``set`` and ``outcome`` may not be that.
    """
    if not isinstance(change, dict):
        return "an event: it has no change"
    row, at_s, sets = (change.get(name) for name in ("row", "at_s", "set"))
    if row is not None and not (type(row) is int and 0 <= row <= 1 << 53):
        return "an event: row is no count in it"
    if not isinstance(change.get("changed"), dict | None):
        return "an event: changed is no object in it"
    if not isinstance(sets, list) or not all(isinstance(each, str) for each in sets):
        return "an event: set is no list of texts in it"
    if at_s is not None and not (isinstance(at_s, int | float) and abs(at_s) <= _LONGEST_S):
        return "an event: at_s is no time in it"
    if not isinstance(change.get("outcome"), str):
        return "an event: outcome is no text in it"
    if not isinstance(change.get("why"), str | None):
        return "an event: why is no text in it"
    return None


def fault_text(piece: Piece) -> Iterator[str]:
    """Describe the fault of a piece in a sentence; rows, events and ends have none."""
    if isinstance(piece, Damage):
        why = f" ({piece.why})" if piece.why else ""
        if piece.last:
            yield (
                f"the last {piece.size} bytes are not a complete block and were skipped{why}; the"
                " run that wrote them was cut off"
            )
        else:
            yield f"{piece.size} bytes from byte {piece.start} on are damaged and were skipped{why}"
    elif isinstance(piece, Misplaced):
        late = piece.rows - piece.twice
        if late:
            yield f"{late} rows come after later ones and were left out"
        if piece.twice:
            yield f"{piece.twice} rows occur twice and were read once"
    elif isinstance(piece, Head):
        yield "another log is joined to it"
