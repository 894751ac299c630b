"""Pieces that a log is made of, and a sentence about each that is wrong."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes that hold no intact block, or what no run writes."""

    start: int
    """Where in the file [bytes]"""
    size: int
    """[bytes]"""
    last: bool
    """Nothing follows: the end was cut off, or is being written"""
    why: str | None = None
    """Content of these bytes, if more is known than that they are no intact block"""


@dataclass(frozen=True, slots=True)
class Misplaced:
    """Rows that are left out: they stand behind later ones, or stand twice."""

    rows: int
    twice: int
    """How many of them are there already"""


@dataclass(frozen=True, slots=True)
class Head:
    """The metadata of another log, which begins here: someone has joined two files."""

    metadata: dict[str, Any]


@dataclass(frozen=True, slots=True)
class End:
    """How the run ended, as its own program has written it."""

    ended: dict[str, Any]
    """``stop_reason`` and ``message`` are texts, or None; ``rows`` is a count, if it is there"""


Piece = NDArray[np.void] | Damage | Misplaced | Head | End


def said_of(piece: Piece) -> Iterator[str]:
    """Describe the fault of a piece in a sentence; rows and ends have none."""
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
            yield f"{late} rows stand behind later ones and were left out"
        if piece.twice:
            yield f"{piece.twice} rows stand there twice and were read once"
    elif isinstance(piece, Head):
        yield "another log is joined to it"
