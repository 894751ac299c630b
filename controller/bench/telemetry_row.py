"""Measures the cost of storing one row in the loop, beside common alternatives."""

from __future__ import annotations

import csv
import json
import logging
import socket
import statistics
import struct
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

from haptic_wall.controller.bench.rows import Measurement, Section
from haptic_wall.controller.runtime.telemetry import FLOAT_FIELDS, INT_FIELDS, ROW, Telemetry
from haptic_wall.controller.runtime.telemetry import Row as TickRow

_HOT, _ROUNDS = 200, 20
"""Consecutive rows, and repetitions"""
_COLD_TURNS, _COLD = 10, 35
"""Turns of each way, and its rows in a turn, with a millisecond of sleep before each"""
_COLD_FIRST = 5
"""Rows of a turn that are not counted: the caches still hold the data of the way before"""
_NAP_S = 0.001
_NAMES: Final = (*INT_FIELDS, *FLOAT_FIELDS)
_PACKED: Final = struct.Struct(f"<{len(INT_FIELDS)}q{len(FLOAT_FIELDS)}d")
_VALUES: Final[tuple[float, ...]] = (
    *(987_654, 34_155_595_103_739, 1_234, 41_234, 161_234, 34_155_595_110_973),
    *(201_234, 0, 0, 2, 0, 0),
    *(0.012271846303085, -0.076699039394282, -0.096640978, -0.0968, 8.0, 0.02, 0.00131, -0.0941),
    0.0,
)
"""A typical row of a run"""

_OURS: Final = "haptic-wall, shared memory"
_NOTHING: Final = "nothing"

Write = Callable[[], object]
"""Writes the row once"""


def measure() -> Section:
    """Measure the time of storing one row, in sequence and once a millisecond, and its size."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        ways = _ways(Path(folder), stack)
        hot = _hot(ways)
        cold = once_a_while(ways, _COLD_TURNS)
        sizes = _sizes([name for name in ways if name != _NOTHING], Path(folder), stack)
    rows = [
        Measurement(
            "a call of nothing, once every millisecond",
            cold[_NOTHING],
            "µs",
            "a row: it is the time to wake up and read the clock, a part of each figure below",
        )
    ]
    for name in sizes:
        rows += [
            Measurement(
                f"{name}, one row, once every millisecond",
                cold[name],
                "µs",
                "a loop's other work, which uses the caches as well",
            ),
            Measurement(
                f"{name}, one row, in a row",
                hot[name],
                "µs",
                "a loop, which writes one row a period, with other data in the caches",
            ),
            Measurement(
                f"{name}, size of a row",
                sizes[name],
                "B",
                "the log file, which another process packs"
                if name == _OURS
                else "overhead of a file or a network",
            ),
        ]
    return Section(tuple(rows))


def once_a_while(ways: Mapping[str, Write], turns: int) -> dict[str, float]:
    """Return the median time of each way once a millisecond [µs], in turns."""
    taken: dict[str, list[int]] = {name: [] for name in ways}
    for _ in range(turns):
        for name, write in ways.items():
            for number in range(_COLD):
                time.sleep(_NAP_S)
                began_ns = time.perf_counter_ns()
                write()
                took_ns = time.perf_counter_ns() - began_ns
                if number >= _COLD_FIRST:
                    taken[name].append(took_ns)
    return {name: 1e-3 * statistics.median(each) for name, each in taken.items()}


def _hot(ways: Mapping[str, Write]) -> dict[str, float]:
    taken: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(_ROUNDS):
        for name, write in ways.items():
            began_ns = time.perf_counter_ns()
            for _ in range(_HOT):
                write()
            taken[name].append(1e-3 * (time.perf_counter_ns() - began_ns) / _HOT)
    return {name: statistics.median(each) for name, each in taken.items()}


def _ways(folder: Path, stack: ExitStack) -> dict[str, Write]:
    """Return ours, and the common alternatives as a user would write them."""
    telemetry = Telemetry.create(mapped=True)
    stack.callback(telemetry.close)
    own: tuple[Any, ...] = _VALUES[1:]  # the memory assigns row numbers
    table = stack.enter_context((folder / "rows.csv").open("w", newline="", encoding="utf-8"))
    lines = stack.enter_context((folder / "rows.json").open("w", encoding="utf-8"))
    columns = csv.writer(table)
    log = logging.Logger("rows")
    handler = logging.FileHandler(folder / "rows.log", encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(asctime)s %(message)s"))
    log.addHandler(handler)
    stack.callback(handler.close)
    text = " ".join(f"{name}=%s" for name in _NAMES)
    hears = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    hears.bind(("127.0.0.1", 0))
    address = hears.getsockname()
    sends = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    return {
        _OURS: lambda: telemetry.write(TickRow(*own)),
        "csv.writer to a file": lambda: columns.writerow(_VALUES),
        "json.dumps to a file": lambda: lines.write(
            json.dumps(dict(zip(_NAMES, _VALUES, strict=True))) + "\n"
        ),
        "logging to a file": lambda: log.info(text, *_VALUES),
        "struct to a UDP socket": lambda: sends.sendto(_PACKED.pack(*_VALUES), address),
        _NOTHING: lambda: None,
    }


def _sizes(names: Sequence[str], folder: Path, stack: ExitStack) -> dict[str, float]:
    """Return the bytes per row of each way that writes a file; close the files."""
    stack.close()
    rows = _HOT * _ROUNDS + _COLD_TURNS * _COLD
    sizes: Sequence[float] = (
        ROW.itemsize,
        *((folder / f"rows.{kind}").stat().st_size / rows for kind in ("csv", "json", "log")),
        _PACKED.size,
    )
    return dict(zip(names, sizes, strict=True))
