"""The kinds of pieces that a log consists of, and a sentence about each faulty one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


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
    """As in the report's ``changes``; ``row`` and ``changed`` are plausible"""


Piece = NDArray[np.void] | Damage | Misplaced | Head | End | Event


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
