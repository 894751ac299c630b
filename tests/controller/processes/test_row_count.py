"""What the supervisor makes of rows: told at once, counted in batches, none left out."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.detector.state import State
from haptic_wall.controller.processes.plan import Plan
from haptic_wall.controller.processes.row_count import BATCH, RowCount
from haptic_wall.controller.runtime.telemetry import Telemetry
from haptic_wall.controller.settings.load import load_config
from tests.support.rows import row


class Run:
    def __init__(self, tmp_path: Path) -> None:
        self.telemetry = Telemetry.create()
        self.told: list[str] = []
        plan = Plan(load_config("simulated", ()).config, None, tmp_path / "x", {}, None)
        self.count = RowCount(self.telemetry, plan, self.told.append)

    def write(self, rows: int, **values: Any) -> None:
        for _ in range(rows):
            self.telemetry.write(*row(**values))


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Run]:
    made = Run(tmp_path)
    yield made
    made.telemetry.close()


def test_an_oscillation_is_told_at_the_next_look_however_short_it_was(run: Run) -> None:
    run.write(10)
    run.count.look()
    assert run.told == []
    run.write(1, oscillation=State.SUSTAINED)
    run.write(20)
    run.count.look()
    assert "oscillates by itself" in run.told[0]
    run.write(20, stiffness=2.5)
    run.count.look()
    assert "is over; the stiffness is 2.5" in run.told[1]


def test_rows_are_counted_in_batches_and_none_is_left_out(run: Run) -> None:
    lateness = iter(np.random.default_rng(1).integers(0, 100_000, 3 * BATCH))
    counted = []
    for _ in range(60):
        for _ in range(BATCH // 20):
            run.write(1, lateness_ns=int(next(lateness)), torque=0.5)
        run.count.look()
        counted.append(run.count.statistics.rows)
    assert len(set(counted)) == 4  # 0, and after each batch
    run.write(7, lateness_ns=200_000)
    run.count.end()
    statistics = run.count.statistics
    assert (statistics.rows, statistics.unread) == (3 * BATCH + 7, 0)
    assert statistics.lateness.as_report()["max"] == 200.0
    assert statistics.max_torque == 0.5
