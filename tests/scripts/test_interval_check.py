"""The tables of docs/evidence/interval-check.md are computed anew; the exact model is right."""

import numpy as np
import pytest

from haptic_wall.controller.theory import critical_stiffness
from scripts.irregular_loop import (
    PERIOD,
    Loop,
    interval_matrix,
    least_unstable,
    mean_square_radius,
    pattern_radius,
)
from scripts.studies.interval_check import STUDY
from tests.scripts.computed import stale

LOOP = Loop(0.012, 0.012, 0.03, 2)


def test_the_tables_are_what_is_computed(thorough: bool) -> None:
    parts = None if thorough else ["slow_tick"]
    assert stale(STUDY, parts) == [], "run scripts/study interval_check"


@pytest.mark.parametrize("quarters", [4, 6, 12])
def test_a_regular_loop_has_the_limit_of_the_theory(quarters: int) -> None:
    period = quarters * PERIOD / 4
    exact = float(critical_stiffness(0.012, 0.012, 0.03, period, 2 * PERIOD / 4))
    found = least_unstable(
        lambda k: pattern_radius([interval_matrix(LOOP, k, quarters, period)]), 0.9 * exact
    )
    assert found == pytest.approx(exact, rel=1e-3)


def test_the_mean_square_of_one_interval_grows_as_its_pattern_does() -> None:
    matrices = [interval_matrix(LOOP, 50.0, 6, 1.5 * PERIOD)]
    assert mean_square_radius(matrices, [1.0]) == pytest.approx(pattern_radius(matrices) ** 2)


def test_a_lost_tick_has_the_spring_alone() -> None:
    lost = interval_matrix(Loop(0.012, 0.012, 0.03, 0), 50.0, 8, 2 * PERIOD, lost=4)
    first = interval_matrix(Loop(0.012, 0.012, 0.03, 0), 50.0, 4, PERIOD)
    held = np.eye(3)
    held[:, 2] = 0.0
    state = np.array([0.01, 0.2, 0.1])
    assert lost @ state != pytest.approx(first @ (first @ state))
    assert (lost @ [0.0, 0.0, 1.0])[1] == pytest.approx((first @ [0.0, 0.0, 1.0])[1], rel=2e-3)
