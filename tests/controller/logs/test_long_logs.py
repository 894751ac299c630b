"""A log of hours takes no more memory than one of minutes, and says what the whole would say."""

import tracemalloc
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.logs.csv_export import write_csv
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.writer import LogWriter
from haptic_wall.controller.report import sketch
from haptic_wall.controller.report.sketch import sketched
from haptic_wall.controller.theory.checks import IntArray
from tests.support.rows import ORIGIN_NS
from tests.support.told_logs import metadata, rows


def written(path: Path, count: int) -> Path:
    with LogWriter(path, metadata()) as log:
        for start in range(0, count, 250):
            log.append(rows(250, start)[:, None])
    return path


def peak(work: Callable[[], object]) -> float:
    """Memory taken by some work at its worst [MB]."""
    tracemalloc.start()
    work()
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return most / 1e6


@pytest.mark.whole
def test_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    logs = [written(tmp_path / f"{count}.hwlog", count) for count in (2_000, 10_000)]

    def do(path: Path) -> None:
        write_csv(tmp_path / "a.csv", LogReader.open(path))

    do(logs[0])  # what is loaded and compiled on first use
    short, long = (peak(partial(do, path)) for path in logs)
    # The rows grow by 1.3 MB; what is held are a few blocks.
    assert long < short + 0.3


def test_a_sketch_keeps_every_peak_in_little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    count, block = 100_000, 2000
    monkeypatch.setattr(sketch, "SLICES", 200)
    monkeypatch.setattr(sketch, "WHOLE", 800)

    def blocks() -> Iterator[NDArray[np.void]]:
        for start in range(0, count, block):
            some = rows(block, start)
            number = np.arange(start, start + block)
            some["torque"][number == 23_457] = 3.0
            some["missed"][number == 62_222] = 5
            yield some

    made = []
    assert peak(lambda: made.append(sketched(blocks(), count, ORIGIN_NS))) < 3.5  # of 16 MB
    (drawn,) = made
    assert drawn.rows["torque"].max() == 3.0
    assert 62_222 in drawn.rows["seq"]
    assert (drawn.rows["seq"][0], drawn.rows["seq"][-1]) == (0, count - 1)
    seq: IntArray = drawn.rows["seq"].astype(np.int64)
    assert np.all(np.diff(seq) > 0)
    assert len(drawn.rows) < 25 * 200
    assert drawn.time[-1] == pytest.approx(99.999)
    assert drawn.mean_velocity.size == 200
