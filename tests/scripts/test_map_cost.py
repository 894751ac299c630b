"""The growth of a map's cost is found, and the projection made of it."""

import pytest

from scripts.studies.map_cost import STUDY, Case, Cost, cases, dampings, growth_lines, writing
from scripts.study import usual


def test_a_straight_growth_is_found_and_projected() -> None:
    found = [
        (Case(n, 1, "processes"), Cost(9.0, 3.0 + 2e-3 * n, 100.0 + 0.01 * n, 100 * n, 0.1))
        for n in (50, 1000, 10_000)
    ]
    (line,) = (line for line in growth_lines(found) if line.startswith("- 1 of"))
    assert "3.0 s and 2.00 ms a point" in line
    assert "1,000,000 points: 33 min of processor time, 33 min on 1 free core" in line
    assert "10,100 MB in the largest process, 100 MB of files" in line


def test_a_cluster_and_numpy_alone_take_no_part_in_the_growth() -> None:
    some = [(Case(n, 1, how), Cost(9.0, 1.0, 1.0, 1, 0.1)) for n in (50, 99) for how in ("dask",)]
    assert growth_lines(some) == []


def test_maps_have_about_the_points_asked_for() -> None:
    given = usual(STUDY, quick=True)
    assert {case.points for case in cases(given)} >= set(given.points)
    assert len(dampings(1000)) * 50 == 1000
    assert len(dampings(1)) == 1


@pytest.mark.whole
@pytest.mark.filterwarnings("default")
def test_writing_is_measured() -> None:
    took = writing(50)
    assert took.write_s > 0.0
