"""Reads a profile of torque over position from a CSV file."""

from __future__ import annotations

import csv
from pathlib import Path

from pydantic_core import PydanticCustomError

from haptic_wall.controller.settings.refusal import refusal
from haptic_wall.controller.system import regular_file
from haptic_wall.hw.errors import Problem

COLUMNS = ("position_rad", "torque_nm")
MOST_BYTES = 2**18
"""Largest size of a file"""


def profile_of(source: str) -> tuple[tuple[float, float], ...]:
    """Return the rows of a CSV file, as position [rad] and torque [N·m].

    Args:
        source: Its path.

    Raises:
        PydanticCustomError: It cannot be read, or a row holds no numbers.
    """
    try:
        text = regular_file.content(Path(source), MOST_BYTES).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise _refusal(f"found {source}, which cannot be read: {reason}") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    table = csv.DictReader(lines)
    missing = [name for name in COLUMNS if name not in (table.fieldnames or ())]
    if missing:
        raise _refusal(f"found {source} without the column {' and '.join(missing)}")
    found = []
    for number, row in enumerate(table, start=1):
        try:
            found.append((float(row[COLUMNS[0]]), float(row[COLUMNS[1]])))
        except (TypeError, ValueError):
            raise _refusal(f"found {source}, whose row {number} holds no two numbers") from None
    return tuple(found)


def _refusal(found: str) -> PydanticCustomError:
    wanted = f"a CSV file with the columns {' and '.join(COLUMNS)}, or a list of pairs"
    return refusal(Problem(found, wanted=wanted))
