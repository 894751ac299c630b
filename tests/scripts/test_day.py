"""The day on the simulated clock: short ones hold, and what would not hold is found."""

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.runtime.telemetry import ROW, Row
from haptic_wall.hw.servo import Outcome
from scripts.soak import PERIOD_NS
from scripts.studies.day import Passed, WatchedTelemetry, long_run, turning

TICKS = 15_000


def rows_of_a_run() -> NDArray[np.void]:
    rows = np.zeros(TICKS, ROW)
    rows["seq"] = np.arange(TICKS)
    rows["deadline_ns"] = 5 + PERIOD_NS * np.arange(TICKS)
    rows["outcome"] = Outcome.OK
    return rows


def passed(rows: NDArray[np.void]) -> Passed:
    telemetry = WatchedTelemetry.create()
    for start in range(0, TICKS, 4096):
        for row in rows[start : start + 4096].tolist():
            telemetry.write(Row(*row[1:]))
        telemetry.read(start)
    return telemetry.passed


def test_a_run_as_it_should_be_has_nothing_to_show() -> None:
    found = passed(rows_of_a_run())
    assert found.rows == TICKS
    assert (found.off_grid, found.off_seq, found.failed, found.not_finite, found.alarmed) == (
        0,
    ) * 5
    assert found.furthest_counts == 0.0


@pytest.mark.parametrize(
    ("column", "value", "seen"),
    [
        ("deadline_ns", 10_000 * PERIOD_NS + 6, "off_grid"),
        ("outcome", Outcome.LOST, "failed"),
        ("position", np.nan, "not_finite"),
        ("oscillation", 2, "alarmed"),
    ],
)
def test_one_tick_that_is_not_as_the_others_is_found(column: str, value: float, seen: str) -> None:
    rows = rows_of_a_run()
    rows[column][10_000] = value
    assert getattr(passed(rows), seen) == 1


def test_a_round_of_the_hand_that_is_not_as_the_others_is_found() -> None:
    rows = rows_of_a_run()
    rows["position"][13_000] = 0.01
    assert passed(rows).furthest_counts == pytest.approx(0.01 / (2 * np.pi / 4096), rel=0.01)


def test_a_quarter_of_a_minute_holds_all_that_is_looked_at() -> None:
    found = long_run(("simulated", 0.004))
    assert [row for row in found if row[2] is False] == []
    assert ("ticks", "14400 of 14400", True) in found


def test_a_shaft_that_turns_on_and_on_is_where_it_is_said_to_be() -> None:
    found = turning(0.02)
    assert [row for row in found if row[2] is False] == []
