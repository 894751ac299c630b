"""Reads the numbers in a CSV of any origin, within bounds of bytes, rows and line length."""

from __future__ import annotations

import csv
import io
import math
import os
from array import array
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Final, TextIO

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.files import opened
from haptic_wall.controller.system.printable import in_line

_MOST_IN_LINE: Final = 1 << 16
"""Longest line [characters]"""
_LARGEST: Final = 1e12
_Refusal = Callable[..., UserError]


def read_columns(
    path: Path,
    needed: Sequence[str],
    known: Sequence[str] = (),
    *,
    field: str,
    most_rows: int,
    most_bytes: int,
) -> dict[str, array[float]]:
    """Return the columns by name, all of one length; a cell that is empty or nan is NaN.

    Lines that begin with # are comments.

    Args:
        path: The file.
        needed: Columns that must be there.
        known: Columns that are read where they are.
        field: The argument, option or setting that names the file, for messages.
        most_rows: Largest number of rows.
        most_bytes: Largest size of the file.

    Raises:
        UserError: The file is no such CSV, or too large; the message says what was found.
        OSError: It cannot be read, or is no regular file.
    """
    refusal = partial(UserError, field=field, given=path)
    with io.TextIOWrapper(opened(path), "utf-8-sig", "replace", newline="") as text:
        size = os.fstat(text.fileno()).st_size
        if size > most_bytes:
            wanted = f"a CSV of at most {most_bytes} bytes"
            raise refusal(f"found {size} bytes", wanted=wanted, advice="split it")
        reader = csv.reader(_lines(refusal, text))
        try:
            header = [name.strip() for name in next(filter(None, reader), [])]
            if absent := [name for name in needed if name not in header]:
                found = in_line(", ".join(header[:8])) if any(header) else "nothing"
                names = [", ".join(needed), *([", ".join(known)] if known else [])]
                raise refusal(
                    f"its first line has no column {' and no '.join(absent)}, found {found}",
                    advice=f"wanted a CSV with {' and, if known, '.join(names)}, commas between"
                    " cells and points in numbers",
                )
            names = [name for name in (*needed, *known) if name in header]
            places = [header.index(name) for name in names]
            columns = {name: array("d") for name in names}
            cells = list(zip(places, columns.items(), strict=True))
            for row in reader:
                if not row:
                    continue
                if len(cells[0][1][1]) >= most_rows:
                    what = f"found more than {most_rows} rows"
                    raise refusal(what, wanted="fewer", advice="split it")
                for place, (name, numbers) in cells:
                    cell = row[place].strip() if place < len(row) else ""
                    try:
                        numbers.append(_number(cell) if cell else math.nan)
                    except ValueError:
                        raise refusal(
                            f"line {reader.line_num}, column {name}: found {cell[:40]!r}",
                            wanted=f"a number up to {_LARGEST:g} or nothing",
                        ) from None
        except csv.Error as error:
            raise refusal(
                f"cannot be read as a CSV: {error}",
                advice="look for a quote that is not closed; wanted rows of numbers",
            ) from None
    return columns


def _lines(refusal: _Refusal, text: TextIO) -> Iterator[str]:
    """Yield the lines of a text, comments as empty ones; refuse long ones."""
    for number, line in enumerate(iter(partial(text.readline, _MOST_IN_LINE + 1), ""), 1):
        if len(line) > _MOST_IN_LINE:
            raise refusal(
                f"line {number} has more than {_MOST_IN_LINE} characters",
                advice="wanted a CSV as text, a line a sample",
            )
        yield "\n" if line.lstrip().startswith("#") else line


def _number(text: str) -> float:
    """Convert a cell as ``float`` does, but refuse 1_000 and values beyond any measurement.

    Raises:
        ValueError: It is no number.
    """
    number = float(text)
    if "_" in text or (math.isfinite(number) and abs(number) > _LARGEST):
        raise ValueError(text)
    return number
