"""Reads the record of an emulated bus: true motion and frames, as the bus itself wrote them."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_END: Final = 4096
"""Bytes at the end of a record that hold at least one whole line"""


@dataclass(frozen=True, slots=True)
class BusRow:
    """One event; position, velocity and torque are the true values."""

    time_s: float
    """On the clock of ``time.monotonic()``"""
    event: str
    """``rx`` (an instruction has taken effect), ``tx`` (a reply was sent), ``state`` (every
    millisecond, for every servo), ``fault``"""
    id: int
    """254: all"""
    instruction: int | None
    """Its number, 85 in a reply; None: there is none"""
    position_rad: float
    velocity_rad_s: float
    torque_nm: float
    """The acting torque"""
    error: int | None
    """The error byte of a reply"""
    params: bytes
    """Parameters of the frame"""
    fault: str
    """The name of a ``fault``"""


def read_rows(record: Path) -> list[BusRow]:
    """Return all rows written so far."""
    return list(rows_of(record))


def rows_of(record: Path) -> Iterator[BusRow]:
    """Yield the rows one by one, for long records."""
    with record.open(encoding="utf-8", newline="") as file:
        next(file, None)
        for cells in csv.reader(line for line in file if line.endswith("\n")):
            yield _row(cells)


def written_until(record: Path) -> float:
    """Return the time of the last whole row [s]; minus infinity if there is none."""
    with record.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - _END))
        lines = file.read().split(b"\n")[:-1]
    time_s = lines[-1].partition(b",")[0] if lines else b"time_s"
    return float("-inf") if time_s == b"time_s" else float(time_s)


def _row(cells: Sequence[str]) -> BusRow:
    time_s, event, id_, instruction, position, velocity, torque, error, params, fault = cells
    return BusRow(
        float(time_s),
        event,
        int(id_),
        int(instruction) if instruction else None,
        float(position),
        float(velocity),
        float(torque),
        int(error) if error else None,
        bytes.fromhex(params),
        fault,
    )
