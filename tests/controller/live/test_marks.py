"""Events of a run are found in its rows, with the same words however the rows are divided."""

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.detector.state import State
from haptic_wall.controller.live.marks import Mark, MarkFinder
from haptic_wall.controller.runtime.telemetry import FLAG_OFF, FLAG_WARM_UP
from haptic_wall.hw.servo import Outcome
from tests.support.rows import ORIGIN_NS, rows_of


def a_run() -> NDArray[np.void]:
    rows = rows_of(1000, stiffness=10.0)
    rows["flags"][:50] = FLAG_WARM_UP
    rows["outcome"][[100, 103, 160, 700]] = Outcome.LOST
    rows["missed"][300] = 3
    rows["oscillation"][400:450] = State.DECAYING
    rows["oscillation"][450:] = State.GROWING
    rows["stiffness"][451:501] = np.linspace(10.0, 4.0, 50)
    rows["stiffness"][501:] = 4.0
    rows["flags"][800:900] = FLAG_OFF
    return rows


@pytest.mark.parametrize("size", [1, 33, 1000])
def test_each_event_has_its_time_and_words(size: int) -> None:
    rows, finder = a_run(), MarkFinder()
    marks: list[Mark] = []
    for start in range(0, len(rows), size):
        marks += finder.look(rows[start : start + size], ORIGIN_NS)
    found = sorted((round(mark.time_s, 3), mark.kind, mark.words) for mark in marks)
    assert found == [
        (0.05, "wall", "the wall is on"),
        (0.1, "loss", "3 replies lost"),
        (0.3, "loss", "3 ticks missed"),
        (0.45, "alarm", "oscillation: growing"),
        (0.452, "reduction", "stiffness 10 → 4 N·m/rad"),
        (0.7, "loss", "1 reply lost"),
        (0.8, "wall", "the wall is off"),
        (0.9, "wall", "the wall is on"),
    ]
