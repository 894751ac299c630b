"""Reads the numbers in a CSV of any origin, within bounds of bytes, rows and line length."""

from __future__ import annotations

import csv
import io
import math
import os
import re
from array import array
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.file import SUFFIX
from haptic_wall.controller.logs.recording import MOST_ROWS, Floats
from haptic_wall.controller.system.csv_habits import ADVICE, WANTED, habits, has_decimal_comma
from haptic_wall.controller.system.files import opened
from haptic_wall.controller.system.printable import in_line

NEEDED = ("time_s", "position_rad")
TORQUE = "torque_nm"
MOST_BYTES = 1 << 29
_MOST_IN_LINE = 1 << 16
"""Longest line [characters]"""
_LARGEST = 1e12
_OR_LOG = f", or a {SUFFIX} file"
Refusal = Callable[..., UserError]
"""Makes the error about a file, of its text, ``wanted`` and ``advice``"""
_CONTROL = re.compile("[\x00-\x08\x0b-\x0c\x0e-\x1f\x7f]")


def columns_of(
    path: Path, known: tuple[str, ...] = (TORQUE,), name: str = "LOG"
) -> tuple[dict[str, Floats], list[str]]:
    """Return the known columns as numbers, shape (n,) each; a cell that is empty or nan is NaN.

    Lines that begin with # are comments.

    Args:
        path: The file.
        known: Columns that are read where they are, besides ``NEEDED``.
        name: The argument or option that names the file, for messages.

    Returns:
        The columns by name, and sentences on what was left out. Every row has a time.

    Raises:
        UserError: The file is no such CSV, or too large; the message says what was found.
        OSError: It cannot be read, or is no regular file.
    """
    refusal = partial(UserError, field=name, given=path)
    with io.TextIOWrapper(opened(path), "utf-8-sig", "replace", newline="") as text:
        size = os.fstat(text.fileno()).st_size
        if size > MOST_BYTES:
            wanted = f"a CSV of at most {MOST_BYTES} bytes"
            raise refusal(f"found {size} bytes", wanted=wanted, advice="split it")
        try:
            names, numbers = _read(refusal, text, known)
        except csv.Error as error:
            raise refusal(
                f"cannot be read as a CSV: {error}",
                advice="look for a quote that is not closed; wanted rows of numbers",
            ) from None
    table = np.frombuffer(numbers, np.float64).reshape(-1, len(names))
    dated = np.isfinite(table[:, 0])
    notes = []
    if not dated.all():
        notes.append(f"{np.count_nonzero(~dated)} rows have no time and are left out")
    return {name: table[dated, place] for place, name in enumerate(names)}, notes


def _lines(refusal: Refusal, text: TextIO) -> Iterator[str]:
    """Yield the lines of a text, comments as empty ones; refuse long ones and other files."""
    for number, line in enumerate(iter(partial(text.readline, _MOST_IN_LINE + 1), ""), 1):
        what = ""
        if len(line) > _MOST_IN_LINE:
            open_quote = ", perhaps after a quote that is not closed" if '"' in line else ""
            what = f"has more than {_MOST_IN_LINE} characters{open_quote}"
        elif found := _CONTROL.search(line):
            what = f"holds the control character {found[0]!r}"
        if what:
            advice = f"wanted a CSV as text, a line for each sample, or a {SUFFIX} file"
            raise refusal(f"line {number} {what}", advice=advice)
        yield "\n" if line.lstrip().startswith("#") else line


def _read(refusal: Refusal, text: TextIO, known: tuple[str, ...]) -> tuple[list[str], array[float]]:
    """Return the names of the known columns, and their numbers row by row."""
    reader = csv.reader(_lines(refusal, text))
    first = next(filter(None, reader), [])
    header = [name.strip() for name in first]
    absent = [name for name in NEEDED if name not in header]
    if absent:
        if habits([first]):
            found = habits([first, *islice(reader, 2)])
            raise refusal(f"found {found}", wanted=WANTED, advice=ADVICE)
        found = in_line(", ".join(header[:8])) if any(header) else "nothing"
        or_log = _OR_LOG if known == (TORQUE,) else ""
        raise refusal(
            f"its first line has no column {' and no '.join(absent)}, found {found}",
            advice=f"wanted a CSV with {', '.join(NEEDED)} and, if known, {', '.join(known)}"
            + or_log,
        )
    names = [name for name in (*NEEDED, *known) if name in header]
    places = [header.index(name) for name in names]
    numbers = array("d")
    last = reader.line_num
    for row in reader:
        if reader.line_num > last + 1:
            what = f"lines {last + 1} to {reader.line_num} are one row"
            raise refusal(what, advice="look for a quote that is not closed")
        last = reader.line_num
        if not row:
            continue
        if len(numbers) >= MOST_ROWS * len(names):
            what = f"found more than {MOST_ROWS} rows"
            raise refusal(what, wanted="fewer", advice="split it")
        for place, name in zip(places, names, strict=True):
            cell = row[place].strip() if place < len(row) else ""
            try:
                numbers.append(_number(cell) if cell else math.nan)
            except ValueError:
                comma = has_decimal_comma(cell)
                raise refusal(
                    f"line {reader.line_num}, column {name}: found {cell[:40]!r}",
                    wanted="a point" if comma else f"a number up to {_LARGEST:g} or an empty cell",
                    advice=ADVICE if comma else "",
                ) from None
    return names, numbers


def _number(text: str) -> float:
    """Convert a cell as ``float`` does, but refuse 1_000 and values beyond any measurement.

    Raises:
        ValueError: It is no number.
    """
    number = float(text)
    if "_" in text or (math.isfinite(number) and abs(number) > _LARGEST):
        raise ValueError(text)
    return number
