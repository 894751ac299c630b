"""Recognises this program's files by their first bytes: only those may be replaced."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

from haptic_wall import __version__

_HEAD = 4096
"""Number of bytes read at the beginning of a file"""


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of file that this program writes."""

    name: str
    """With its article"""
    begins: re.Pattern[bytes]
    """Matches the beginning of every such file, within 4096 bytes"""


LOG = Kind(
    "a log of haptic-wall",
    re.compile(rb"SQLite format 3\x00.{52}hwlg", re.DOTALL),
)
SOFTWARE = "haptic-wall"
"""The ``Software`` tag of every picture"""
PICTURE = Kind(
    "a picture of haptic-wall",
    re.compile(rb"\x89PNG\r\n\x1a\n.{0,200}tEXtSoftware\x00haptic-wall", re.DOTALL),
)
RESULT_MARK = {"program": f"haptic-wall {__version__}"}
"""First entry of every result's JSON"""
RESULT = Kind(
    "a result of haptic-wall",
    re.compile(rb'\{\s*"(program|format)": "haptic-wall '),
)
RECORD = Kind("a record of an emulated bus", re.compile(rb"time_s,event,id,instruction,"))

BUNDLE = Kind("a zip file", re.compile(rb"PK\x03\x04"))


def table(columns: str) -> Kind:
    """Return the kind of CSV files whose header begins with these comma-separated columns."""
    return Kind("a table of haptic-wall", re.compile(re.escape(columns.encode())))


def may_be_replaced(path: Path, kind: Kind) -> bool:
    """Whether a new file of a kind may replace the one at ``path`` without loss.

    Args:
        path: May be free, an empty file, or a file of this kind.
        kind: The kind of the new file.
    """
    if not os.path.lexists(path):
        return True
    try:
        if not path.is_file():
            return not path.exists()  # a dangling link
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return False
    return not head or kind.begins.match(head) is not None
