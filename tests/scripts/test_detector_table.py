"""The detector's table: what is drawn, what its lines say, and a run of each of its sections."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from haptic_wall.controller.settings.load import load_config
from scripts.rates import lower_bound, most_per_hour, upper_bound
from scripts.studies.detector_table import KINDS_TRIED, STUDY, jobs, tried
from scripts.study import Kept, usual
from tests.scripts.computed import stale
from tests.support.cases_drawn import LAWS, PRESETS, draw_law
from tests.support.truths_drawn import bench_of


def test_bounds_exclude_what_would_have_been_seen_more_often() -> None:
    bound = upper_bound(2, 50)
    seen = sum(math.comb(50, k) * bound**k * (1.0 - bound) ** (50 - k) for k in range(3))
    assert seen == pytest.approx(0.05)
    assert lower_bound(48, 50) == pytest.approx(1.0 - bound)
    assert upper_bound(50, 50) == 1.0
    assert most_per_hour(0, 30.0) == pytest.approx(-math.log(0.05) / 30.0)
    with pytest.raises(ValueError, match="5 hits in 4 trials"):
        upper_bound(5, 4)
    with pytest.raises(ValueError, match="time above 0"):
        most_per_hour(0, 0.0)


def test_every_combination_is_drawn_with_a_seed_of_its_own() -> None:
    for given, many in ((usual(STUDY, quick=True), False), (usual(STUDY), True)):
        for name, kind in KINDS_TRIED.items():
            drawn = list(jobs(name, given))
            assert len({job.values for job in drawn}) == math.prod(map(len, kind.axes))
            seeds = {(*job.seed, *job.values) if name == "ceiling" else job.seed for job in drawn}
            assert len(seeds) == len(drawn)
            assert (max(job.count for job in drawn) > 1) is (many and name != "real hands")
    hours = sum(job.count * job.seconds for job in jobs("hands", usual(STUDY, hours=1.0))) / 3600.0
    assert hours == pytest.approx(2 * (5 * 1.0 + 4 * 0.1))


@pytest.mark.parametrize("law", LAWS)
def test_every_law_is_drawn_with_numbers_that_a_configuration_takes(law: str) -> None:
    drawn = {draw_law(law, np.random.default_rng(seed)) for seed in range(5)}
    for sets in drawn:
        config = load_config("simulated", (*bench_of(PRESETS[0]).sets, *sets), runs=True).config
        assert config.law(0.0).name in (law, sets[0].partition("=")[2])
    assert len(drawn) == (1 if law in ("spring", "damper") else 5)


@pytest.mark.whole
@pytest.mark.parametrize("name", KINDS_TRIED)
def test_a_section_runs_and_its_rows_are_kept(name: str, tmp_path: Path) -> None:
    part = next(
        one for one in STUDY.parts if one.name.rstrip("s") == name.split(maxsplit=1)[0].rstrip("s")
    )
    job = list(jobs(name, usual(STUDY, quick=True, walls=2)))[-1]
    row = tried(replace(job, count=1))
    assert row.drawn >= 1
    assert bool(row.hands) is (KINDS_TRIED[name].hours is not None)
    kept = Kept(tmp_path / "rows")
    kept.add(part, job, row)
    again = Kept(tmp_path / "rows").rows(part, [job])[0]
    assert repr(again) == repr(row)
    assert len(list(part.lines([(job, row)]))) > 2


@pytest.mark.whole
def test_the_page_is_what_is_computed() -> None:
    found = stale(STUDY, ["limit"], walls=6, seed=61005)
    assert found == [], "run scripts/study detector_table as the page says"
