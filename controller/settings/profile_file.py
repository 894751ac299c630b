"""Reads a profile of torque over position from a CSV file."""

from __future__ import annotations

import csv
from pathlib import Path

from pydantic_core import PydanticCustomError

from haptic_wall.controller.settings.refusal import refusal
from haptic_wall.controller.system import files
from haptic_wall.controller.system.csv_habits import ADVICE, WANTED, habits, has_decimal_comma
from haptic_wall.hw.errors import Problem

COLUMNS = ("position_rad", "torque_nm")
MOST_BYTES = 2**18
"""Largest size of a file"""
MOST_ROWS = 4096
"""Most rows of a profile"""
LARGEST = 1e6
"""Largest position [rad] and torque [N·m] of a row"""


def profile_of(source: str) -> tuple[tuple[float, float], ...]:
    """Return the rows of a CSV file, as position [rad] and torque [N·m].

    Args:
        source: Its path.

    Raises:
        PydanticCustomError: It cannot be read, or a row holds no numbers.
    """
    try:
        text = files.content(Path(source), MOST_BYTES).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise _refusal(f"found {source}, which cannot be read: {reason}") from None
    lines = ["" if line.startswith("#") or not line.strip() else line for line in text.splitlines()]
    reader = csv.reader(lines)
    try:
        table = [(reader.line_num, row) for row in reader if row]
    except csv.Error as error:
        raise _refusal(f"found {source}, whose line {reader.line_num} is no CSV: {error}") from None
    names = [name.strip() for name in table[0][1]] if table else []
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        if found := habits([row for _, row in table[:3]]):
            problem = Problem(f"found {source} with {found}", wanted=WANTED, advice=ADVICE)
            raise refusal(problem)
        raise _refusal(f"found {source} without the column {' and '.join(missing)}")
    if len(table) - 1 > MOST_ROWS:
        raise _refusal(f"found {source} with {len(table) - 1} rows", f"at most {MOST_ROWS} rows")
    places = [names.index(name) for name in COLUMNS]
    return tuple(_pair(source, line, row, places) for line, row in table[1:])


def _pair(source: str, line: int, row: list[str], places: list[int]) -> tuple[float, float]:
    try:
        position, torque = (float(row[place]) for place in places)
    except (IndexError, ValueError):
        if any(map(has_decimal_comma, row)):
            found = f"found {source}, whose line {line} holds decimal commas"
            raise refusal(Problem(found, wanted="points", advice=ADVICE)) from None
        raise _refusal(f"found {source}, whose line {line} holds no two numbers") from None
    for number in (position, torque):
        if not abs(number) <= LARGEST:
            raise _refusal(
                f"found {source}, whose line {line} holds {number:g}",
                f"numbers from {-LARGEST:g} to {LARGEST:g}",
            )
    return position, torque


def _refusal(found: str, wanted: str = "") -> PydanticCustomError:
    columns = f"a CSV file with the columns {' and '.join(COLUMNS)}, or a list of pairs"
    return refusal(Problem(found, wanted=wanted or columns))
