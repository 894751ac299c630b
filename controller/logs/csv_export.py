"""Exports the rows of a log as CSV, with enough digits to read back exactly."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.logs.columns import columns_of, values
from haptic_wall.controller.logs.reader import LogReader


def write_csv(path: Path, log: LogReader) -> None:
    """Write all columns of all rows; ``time_s`` counts from the log's first row, NaN is empty.

    Raises:
        OSError: The file cannot be written.
    """
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        columns = columns_of(log.axes)
        writer.writerow(columns)
        for rows in log.ticks():
            texts = [
                _column(values(rows[:, k], name, log.origin_ns)) for name, k in columns.values()
            ]
            writer.writerows(zip(*texts, strict=True))


def _column(numbers: NDArray[Any]) -> list[str]:
    texts = list(map(repr, numbers.tolist()))
    if numbers.dtype.kind == "f" and np.isnan(numbers).any():
        return ["" if text == "nan" else text for text in texts]
    return texts
