"""Decodes a block: rows, metadata, an event, or the end of a run.

It checks the content too: correct checksums do not prove that this program wrote the block.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.state import State
from haptic_wall.controller.logs.blocks import Block
from haptic_wall.controller.logs.pieces import End, Event, Head, Piece, fault_of_change
from haptic_wall.controller.runtime.telemetry import FLOAT_FIELDS, INT_FIELDS, ROW
from haptic_wall.controller.system import json_text
from haptic_wall.hw.servo import Outcome

_GROW: Final = ("seq", "deadline_ns")
_LONGEST_NS: Final = 1 << 50
"""Longest plausible time within a tick: some thirteen days"""
_RANGES: Final = {
    "seq": (0, 1 << 53),
    "deadline_ns": (0, 1 << 61),
    "sampled_ns": (-_LONGEST_NS, 1 << 61),
    "outcome": (0, max(Outcome)),
    "oscillation": (0, max(State)),
    "flags": (0, (1 << 16) - 1),
    "phase": (-1, 1 << 20),
    "missed": (0, 1 << 40),
}
"""Least and largest values of the columns that hold no time within a tick"""
_LARGEST: Final = 1e18
"""Largest plausible value of other columns, in SI units; NaN is unknown, and a defect may be
infinite"""


@dataclass(frozen=True, slots=True)
class _Columns:
    """Field names of a row, grouped by the check they need."""

    whole: list[int]
    low: NDArray[np.int64]
    high: NDArray[np.int64]
    real: list[int]
    grow: list[int]


def fault(rows: NDArray[Any]) -> str | None:
    """Name an implausible value in a block of rows; None: all of it is plausible.

    Args:
        rows: Shape (n,); columns of today's rows may be missing, in any order.
    """
    columns = _columns(rows.dtype)
    if columns is None:
        return "its columns are not a loop's"
    if rows.size == 0 or not rows.dtype.names:
        return "it has no rows"
    numbers = rows.view(np.int64).reshape(rows.size, -1)
    whole = numbers[:, columns.whole]
    wrong = np.argwhere((whole < columns.low) | (whole > columns.high))
    if wrong.size:
        row, place = wrong[0]
        name = rows.dtype.names[columns.whole[place]]
        return (
            f"{name} is {whole[row, place]} in it, wanted {columns.low[place]} to"
            f" {columns.high[place]}"
        )
    real = numbers.view(np.float64)[:, columns.real]
    wrong = np.argwhere((np.abs(real) > _LARGEST) & np.isfinite(real))
    if wrong.size:
        row, place = wrong[0]
        name = rows.dtype.names[columns.real[place]]
        return f"{name} is {real[row, place]:g} in it, which is too large"
    back = np.argwhere(np.diff(numbers[:, columns.grow], axis=0) <= 0)
    if back.size:
        name = rows.dtype.names[columns.grow[back[0][1]]]
        return f"{name} does not increase in it"
    return None


def refusal(dtype: np.dtype[Any]) -> str | None:
    """Return why no loop writes rows of this type; None: one does, or did without later columns."""
    for name in dtype.names or ():
        if name not in _OURS:
            return f"its rows have a column {name[:40]!r} that this program does not know"
        if dtype[name] != _OURS[name]:
            return (
                f"its column {name} is of type {str(dtype[name])[:40]!r}, wanted"
                f" {_OURS[name].str!r}"
            )
    return None


_OURS: Final = {name: ROW[name] for name in (*INT_FIELDS, *FLOAT_FIELDS)}


@functools.lru_cache(maxsize=8)
def _columns(dtype: np.dtype[Any]) -> _Columns | None:
    if refusal(dtype) is not None or dtype.itemsize != 8 * len(dtype.names or ()):
        return None
    names = dtype.names or ()
    whole = [place for place, name in enumerate(names) if name in INT_FIELDS]
    ranges = [_RANGES.get(names[place], (-_LONGEST_NS, _LONGEST_NS)) for place in whole]
    return _Columns(
        whole,
        np.array([low for low, _ in ranges], np.int64),
        np.array([high for _, high in ranges], np.int64),
        [place for place, name in enumerate(names) if name in FLOAT_FIELDS],
        [place for place, name in enumerate(names) if name in _GROW],
    )


FORMAT = {"format": "haptic-wall log", "version": 1, "checksum": "crc32"}
"""First keys in the metadata of every log; logs of earlier versions have no checksums, and no
``checksum`` key."""
MOST_JSON = 1 << 22
"""Largest size of metadata or of a run's end [bytes]; a larger block is damage"""


EVENT = "change"
"""Only key of an event"""


def judged(
    block: Block, dtype: np.dtype[np.void] | None, checked: bool
) -> tuple[Piece | None, str | None]:
    """Return a block's content; or None and, if known, the reason why it is invalid.

    Args:
        block: Whole; its checksums are correct, where it has any.
        dtype: Type of the preceding rows; None: there are none.
        checked: A block of rows, or an end, without checksums counts as damaged.
    """
    array = block.array
    if array.dtype.names is None:
        content = from_json(array)
        if content is None:
            return None, None
        if is_ours(content):
            return Head(content), None
        if checked and not block.summed:
            return None, None
        if EVENT in content:
            why = fault_of_change(content[EVENT])
            return (Event(content[EVENT]), None) if why is None else (None, why)
        why = _fault_of_end(content)
        return (End(content), None) if why is None else (None, why)
    if checked and not block.summed:
        return None, None
    if dtype not in (None, array.dtype):
        return None, "rows of another type than those before" if block.summed else None
    why = fault(array)
    return (array, None) if why is None else (None, why if block.summed else None)


def refused(block: Block) -> str | None:
    """Return why this program does not accept an intact block's rows; None: it does."""
    named = block.summed and block.array.dtype.names is not None
    return refusal(block.array.dtype) if named else None


def _fault_of_end(ended: Mapping[str, Any]) -> str | None:
    """Return the implausible part of a run's end; None: all of it is plausible."""
    for name in ("stop_reason", "message", "schedule"):
        if not isinstance(ended.get(name), str | None):
            return f"the run's end: {name} is no text in it"
    guard = ended.get("guard") or {}
    if not isinstance(guard, dict) or not _are_texts(guard.get("reasons")):
        return "the run's end: guard has no list of texts as its reasons"
    if not _are_texts(ended.get("warnings")):
        return "the run's end: warnings is no list of texts in it"
    rows = ended.get("rows", 0)
    if not isinstance(rows, int) or not 0 <= rows <= 1 << 53:
        return "the run's end: rows is no count in it"
    return None


def _are_texts(found: object) -> bool:
    """Whether it is a list of texts, or None."""
    texts = found or []
    return isinstance(texts, list) and all(isinstance(each, str) for each in texts)


def is_ours(metadata: Mapping[str, Any]) -> bool:
    """Whether the mapping is the metadata of a log."""
    return metadata.get("format") == FORMAT["format"]


def from_json(array: NDArray[Any]) -> dict[str, Any] | None:
    """Return the object that an array of bytes encodes as JSON; None: it encodes none."""
    if array.dtype != np.uint8 or array.size > MOST_JSON:
        return None
    try:
        content = json_text.parse(array.tobytes())
    except (ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None
