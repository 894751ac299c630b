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


@pytest.mark.parametrize(
    ("count", "schedule", "seconds", "shift_ms"),
    [
        (6, "immediate", 0.1, 0.25),
        *(
            pytest.param(count, schedule, 2.4, shift_ms, marks=pytest.mark.whole)
            for count in (6, 7)
            for schedule in ("immediate", "pipelined")
            for shift_ms in (0.0, 0.25, 0.55, 0.85)
        ),
    ],
)
def test_six_servos_and_seven_lose_no_reply_at_500_hz_behind_a_timer_of_1_ms(
    count: int, schedule: str, seconds: float, shift_ms: float
) -> None:
    axes = ", ".join(f"a{id_}: {{servo: {{id: {id_}}}}}" for id_ in range(1, count + 1))
    sets = [f"axes={{{axes}}}", f"servo.schedule={schedule}", "servo.watchdog_s=0.2"]
    sets += ["loop.rate_hz=500", "loop.warm_up_s=0.05", "wall.law=none"]
    found = run_in_memory(sets, seconds, adapter=(1 * MS, 62), shift_ns=round(shift_ms * MS))
    bus = not_none(found.result.bus)
    assert bus["cycles"] >= 500 * seconds * count
    assert bus["lost"] == bus["late"] == bus["corrupt"] == 0
    assert bus["schedule"] == schedule
