"""Percentiles within a bin of the exact ones; the warm-up and the first tick do not count."""

import numpy as np
import pytest

from haptic_wall.controller.runtime.statistics import RunStatistics, TimeStatistics
from haptic_wall.controller.runtime.telemetry import FLAG_OFF, FLAG_SATURATED, FLAG_WARM_UP, ROW


def test_percentiles_agree_with_numpy() -> None:
    random = np.random.default_rng(1)
    times = (10 ** random.uniform(2, 7, 20_000)).astype(np.int64)
    statistics = TimeStatistics()
    for part in np.array_split(times, 7):
        statistics.add(part)
    report = statistics.as_report(50, 99, 99.9)
    assert list(report) == ["p50", "p99", "p99_9", "max"]
    for name, percentile in (("p50", 50), ("p99", 99), ("p99_9", 99.9)):
        exact = np.percentile(times, percentile) / 1000
        assert report[name] == pytest.approx(exact, rel=2 ** (1 / 64) - 1 + 0.002)
    assert report["max"] == times.max() / 1000


def test_nothing_counted_is_null() -> None:
    assert TimeStatistics().as_report(50) == {"p50": None, "max": None}


def test_a_run() -> None:
    rows = np.zeros(10, dtype=ROW)
    rows["seq"] = np.arange(10)
    rows["flags"][:3] = FLAG_WARM_UP
    rows["flags"][5] |= FLAG_SATURATED
    rows["lateness_ns"] = 1000
    rows["lateness_ns"][0] = 10**9
    rows["torque"] = -0.25
    rows["torque"][7] = -2.0
    statistics = RunStatistics()
    statistics.add(rows[:4, None])
    statistics.add(rows[6:, None])
    assert statistics.unread == 2
    assert statistics.torque() == {"max": 2.0, "saturated_ticks": 0}
    assert statistics.lateness.as_report(50)["max"] == 1.0


def test_which_walls_had_no_stiffness_while_they_were_on() -> None:
    rows = np.zeros((10, 2), dtype=ROW)
    rows["flags"][:3] = FLAG_WARM_UP
    rows["flags"][3:5, 0] = FLAG_OFF
    rows["stiffness"][6:, 0] = 4.0
    statistics = RunStatistics(2)
    statistics.add(rows)
    assert (statistics.acted.tolist(), statistics.limp.tolist()) == ([5, 7], [1, 7])
