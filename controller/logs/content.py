"""Reads a block: rows, metadata, or how a run ended. Right checksums do not make it ours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.logs.blocks import Block
from haptic_wall.controller.logs.pieces import End, Head, Piece
from haptic_wall.controller.logs.plausible import fault, refusal
from haptic_wall.controller.system import json_text

FORMAT = {"format": "haptic-wall log", "version": 1, "checksum": "crc32"}
"""First keys in the metadata of every log; those of before have no checksums, and say so by
having no ``checksum``."""
MOST_JSON = 1 << 22
"""Bytes of metadata, or of how a run ended; more are damage"""


def judged(
    block: Block, dtype: np.dtype[np.void] | None, checked: bool
) -> tuple[Piece | None, str | None]:
    """Return a block's content, or None and, where it is known, why the block is none of ours.

    Args:
        block: Whole; its checksums are right, where it has any.
        dtype: Of the rows before; None: there are none.
        checked: Whether a block of rows, or an end, without checksums counts as damaged.
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
        why = _fault_of_end(content)
        return (End(content), None) if why is None else (None, why)
    if checked and not block.summed:
        return None, None
    if dtype not in (None, array.dtype):
        return None, "rows of another type than those before" if block.summed else None
    why = fault(array)
    return (array, None) if why is None else (None, why if block.summed else None)


def refused(block: Block) -> str | None:
    """Why the rows of an intact block are not such as this program knows; None: they are."""
    named = block.summed and block.array.dtype.names is not None
    return refusal(block.array.dtype) if named else None


def _fault_of_end(ended: Mapping[str, Any]) -> str | None:
    """Name what no run writes about its end; None: all of it is plausible."""
    for name in ("stop_reason", "message"):
        if not isinstance(ended.get(name), str | None):
            return f"how the run ended: {name} is no text in it"
    rows = ended.get("rows", 0)
    if not isinstance(rows, int) or not 0 <= rows <= 1 << 53:
        return "how the run ended: rows is no count in it"
    return None


def is_ours(metadata: Mapping[str, Any]) -> bool:
    """Whether these are a log's metadata."""
    return metadata.get("format") == FORMAT["format"]


def from_json(array: NDArray[Any]) -> dict[str, Any] | None:
    """The object that an array of bytes holds; None: it holds none."""
    if array.dtype != np.uint8 or array.size > MOST_JSON:
        return None
    try:
        content = json_text.parse(array.tobytes())
    except (ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None
