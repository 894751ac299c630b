"""No hand of the page trips, and each runaway within the belief does."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from scripts.studies.overspeed_table import HANDS, RUNAWAYS, played

CASES = 12


def found(draw: Callable[[np.random.Generator], Any]) -> list[Any]:
    rng = np.random.default_rng(3)
    return [played(draw(rng)) for _ in range(CASES)]


@pytest.mark.parametrize("name", HANDS)
def test_hands_do_not_trip(name: str) -> None:
    assert all(math.isnan(outcome.trip_s) for outcome in found(HANDS[name]))


@pytest.mark.parametrize("name", [name for name in RUNAWAYS if "longest lag" not in name])
def test_runaways_trip_as_soon_as_they_are_fast(name: str) -> None:
    fast = [outcome for outcome in found(RUNAWAYS[name]) if not math.isnan(outcome.fast_s)]
    assert fast
    assert all(outcome.trip_s <= outcome.fast_s + 0.01 for outcome in fast)
