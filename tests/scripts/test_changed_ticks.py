"""The table of ticks beside changes: what counts of a log, who is disturbed, what is told."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.processes.ask import NotAppliedError
from haptic_wall.controller.runtime.telemetry import FLAG_CHANGED, FLAG_WARM_UP, ROW
from haptic_wall.hw.errors import Problem
from scripts.studies.changed_ticks import (
    ARMS,
    BEFORE,
    STUDY,
    Ticks,
    cases,
    disturbed,
    figures,
    lines,
)
from scripts.study import usual


def test_the_warm_up_is_left_out_and_ticks_before_a_change_are_told_apart() -> None:
    rows = np.zeros(1000, dtype=ROW)
    rows["work_ns"], rows["lateness_ns"] = 20_000, 1000
    rows["flags"][:100] = FLAG_WARM_UP
    rows["work_ns"][:101] = 900_000  # of warm-up ticks, told by the rows behind them
    rows["flags"][600] = FLAG_CHANGED
    rows["work_ns"][600 - BEFORE + 1 : 602] = 50_000  # of the ticks up to the change
    rows["missed"][700] = 3
    found = figures(rows)
    assert (found.ticks, found.missed, found.made) == (900, 3, 1)
    assert (found.near, found.far) == (50.0, 20.0)
    assert found.work == (20.0, 50.0, 50.0) and found.lateness == (1.0, 1.0, 1.0)
    rows["flags"][600] = 0
    assert math.isnan(figures(rows).near)


def test_a_wall_that_never_came_on_is_told() -> None:
    rows = np.zeros(10, dtype=ROW)
    rows["flags"] = FLAG_WARM_UP
    with pytest.raises(ValueError, match="10 rows with 0 of a wall that is on; run it longer"):
        figures(rows)


class _Wall:
    """It runs for some requests or looks."""

    def __init__(self, *, refuses: bool) -> None:
        self.asked: list[Mapping[str, Any]] = []
        self.looks = 0
        self._refuses = refuses

    def running(self) -> bool:
        self.looks += 1
        return self.looks <= 6

    def set(self, changes: Mapping[str, Any], wait_s: float) -> dict[str, Any]:
        assert wait_s > 0.0
        self.asked.append(changes)
        if self._refuses:
            raise NotAppliedError(Problem("refused", field=None), 2)
        return {}


@pytest.mark.parametrize("arm", range(4))
def test_each_arm_asks_for_what_it_says(arm: int) -> None:
    wall, slept = _Wall(refuses=arm == 2), list[float]()
    disturbed(wall, arm, lambda: sum(slept), slept.append)  # type: ignore[arg-type]
    paths = {path for each in wall.asked for path in each}
    assert paths == [set(), set(), {"loop.rate_hz"}, {"wall.damping"}][arm]
    assert len(wall.asked) == (6 if arm >= 2 else 0)
    assert all(one != other for one, other in zip(wall.asked, wall.asked[1:], strict=False)) or (
        arm == 2
    )
    assert slept[0] > 0.0


def test_every_arm_comes_first_in_some_round() -> None:
    drawn = cases(usual(STUDY))
    assert {arm for arm, _, n in drawn[:: len(ARMS)]} == set(ARMS)
    assert all({c[0] for c in drawn if c[2] == n} == set(ARMS) for n in range(drawn[-1][2] + 1))


def test_the_ratio_is_that_of_the_same_round() -> None:
    def ticks(work: float, made: int = 0) -> Ticks:
        return Ticks(1000, 10, made, (work, 60.0, 99.0), (0.0, 1.0, 2.0), 40.0, 25.0)

    found = [
        ((ARMS[0], 1.0, 0), ticks(20.0)),
        ((ARMS[3], 1.0, 0), ticks(40.0, 5)),
        ((ARMS[0], 1.0, 1), ticks(30.0)),
        ((ARMS[3], 1.0, 1), ticks(30.0, 5)),
    ]
    told = list(lines(found))
    changes = next(line for line in told if line.startswith("| changes |"))
    assert "| 10 | 35 | 1.50 (1.00 to 2.00) | 60 | 99 | 0 | 1 | 0.99 % |" in changes
    assert "median work 40 µs" in told[-1] and "25 µs in the others" in told[-1]
