"""The whole program behind an adapter, in memory on the simulated clock."""

import numpy as np
import pytest

from haptic_wall.controller.theory.checks import IntArray
from haptic_wall.hw.errors import UnfitServoError
from tests.support.memory_session import run_in_memory
from tests.typed import not_none

MS = 1_000_000


def test_one_that_keeps_replies_back_for_periods_is_refused_before_the_wall_comes_on() -> None:
    with pytest.raises(UnfitServoError, match=r"replies take 16\.0 ms"):
        run_in_memory((), 0.3, adapter=(16 * MS, 62))


def test_a_quick_adapter_is_untouched() -> None:
    found = run_in_memory((), 0.3, adapter=(1 * MS, 62))
    age: IntArray = found.ticks["age_ns"]
    assert np.percentile(age, 99) <= 2 * MS
    assert not any("latency timer" in reason for reason in not_none(found.result.guard)["reasons"])
