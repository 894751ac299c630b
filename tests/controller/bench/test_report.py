"""What a report is made of: bins, percentiles, the host's share."""

from pathlib import Path

import numpy as np
import pytest

from haptic_wall.controller.bench.bins import binned, percentile
from haptic_wall.controller.bench.machine import ProcessorTime, processor_time, stolen_percent
from haptic_wall.controller.bench.rows import Histogram
from haptic_wall.controller.bench.words import figure


def test_a_percentile_is_one_of_the_values() -> None:
    values = np.arange(1.0, 1001.0)
    assert [percentile(values, q) for q in (50.0, 99.0, 99.9, 100.0)] == [500, 990, 999, 1000]
    assert percentile(np.array([7.0]), 99.9) == 7.0


@pytest.mark.parametrize(
    ("samples", "scale"),
    [
        ([0.0, 0.04, 5.0, 20_000.0], "log"),
        ([-3.0, 0.0, 4.0], "linear"),
        ([2.0, 2.0], "log"),
        ([0.0, 0.0], "linear"),
    ],
)
def test_no_sample_is_lost_between_the_bins(samples: list[float], scale: str) -> None:
    counted = binned(Histogram("h", "µs", {"one": samples, "none": []}))
    assert counted["scale"] == scale
    assert set(counted["series"]) == {"one"}
    one = counted["series"]["one"]
    assert sum(one["counts"]) == one["samples"] == len(samples)
    assert one["max"] == max(samples)
    edges = np.array(counted["edges"])
    assert np.all(np.diff(edges) > 0)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.04567, "0.0457"), (12.25, "12.2"), (999.97, "1,000"), (423456.0, "423,000"), (None, "–")],
)
def test_figures_have_three_digits(value: float | None, text: str) -> None:
    assert figure(value) == text


def test_the_hosts_share_is_of_all_processors_time(tmp_path: Path) -> None:
    stat = tmp_path / "stat"
    # A guest's 40 ticks are counted in the user's 100 already.
    stat.write_text("cpu  100 0 50 800 10 0 5 35 40 0\ncpu0 1 1\n", encoding="ascii")
    before = processor_time(stat)
    assert before == ProcessorTime(1000, 35)
    assert stolen_percent(before, ProcessorTime(1400, 45)) == 2.5
    assert stolen_percent(before, before) is None
    assert stolen_percent(None, before) is None
    stat.write_text("cpu  1 2 3\n", encoding="ascii")
    assert processor_time(stat) is None
    assert processor_time(tmp_path / "none") is None
