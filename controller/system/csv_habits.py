"""Finds in a CSV what only spreadsheets understand: semicolons, tabs, decimal commas, ``sep=``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

WANTED: Final = "the names of the columns first, commas between cells and points in numbers"
ADVICE: Final = "set the spreadsheet to English and export it again"

_SEPARATORS = {";": "semicolons between cells", "\t": "tabs between cells"}
_IN_ROW = re.compile(r'(^|[;\t])[\s"]*[-+]?\d+,\d')
_IN_CELL = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")


def habits(rows: Sequence[Sequence[str]]) -> str:
    """Describe what keeps the first rows of a CSV from being read; empty: nothing known.

    Args:
        rows: Rows as ``csv.reader`` splits them, at commas.
    """
    lines = [",".join(row) for row in rows]
    found = []
    if lines and lines[0].lower().startswith("sep="):
        found.append(f"a first line {lines.pop(0)[:5]}")
    names = lines[0] if lines else ""
    separators = [text for mark, text in _SEPARATORS.items() if mark in names and "," not in names]
    found += separators
    if separators and any(_IN_ROW.search(line) for line in lines[1:]):
        found.append("decimal commas")
    return " and ".join(found)


def has_decimal_comma(cell: str) -> bool:
    """Whether a cell is a number with a comma in place of the point."""
    return _IN_CELL.fullmatch(cell.strip()) is not None
