"""Exports the rows of a log as CSV, with enough digits to read back exactly."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.logs.columns import COLUMNS, values
from haptic_wall.controller.logs.reader import LogReader


def write_csv(path: Path, log: LogReader) -> None:
    """Write all columns of all rows; ``time_s`` counts from the log's first row, NaN is empty.

    The first row has no exponents: some readers take a column for text if its first cell has one.

    Raises:
        OSError: The file cannot be written.
    """
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        first = True
        for block in log.blocks():
            table = _texts(block, log.origin_ns)
            if first:
                writer.writerow([_plain(text) for text in next(table)])
                first = False
            writer.writerows(table)


def _texts(rows: NDArray[np.void], origin_ns: int) -> Iterator[tuple[str, ...]]:
    columns = [_column(values(rows, column, origin_ns)) for column in COLUMNS]
    return zip(*columns, strict=True)


def _column(numbers: NDArray[Any]) -> list[str]:
    texts = list(map(repr, numbers.tolist()))
    if numbers.dtype.kind == "f" and np.isnan(numbers).any():
        return ["" if text == "nan" else text for text in texts]
    return texts


def _plain(text: str) -> str:
    return np.format_float_positional(float(text), trim="0") if "e" in text else text
