"""Who shares a core with the loop's bytes works when the loop has none under way."""

import time

from hypothesis import given
from hypothesis import strategies as st
from pytest import MonkeyPatch

from haptic_wall.controller.runtime import idle_window
from haptic_wall.controller.runtime.telemetry import Word

NOW_NS = 5_000_000_000
MS = 1_000_000


def pause_ns(ended_ns: int, period_ns: int, wanted_ns: int) -> int:
    words = memoryview(bytearray(4096)).cast("q")
    words[Word.HEARTBEAT_NS] = ended_ns
    with MonkeyPatch.context() as patch:
        patch.setattr(time, "monotonic_ns", lambda: NOW_NS)
        return round(idle_window.until_idle_window(words, period_ns, wanted_ns * 1e-9) * 1e9)


@given(
    since_ns=st.integers(-MS, 9 * MS),
    period_ns=st.integers(MS, 20 * MS),
    wanted_ns=st.integers(0, 300 * MS),
)
def test_a_pause_ends_just_behind_a_tick_and_at_most_a_period_later(
    since_ns: int, period_ns: int, wanted_ns: int
) -> None:
    ended_ns = NOW_NS - since_ns
    paused = pause_ns(ended_ns, period_ns, wanted_ns)
    assert wanted_ns <= paused < wanted_ns + period_ns
    assert 0 < (NOW_NS + paused - ended_ns) % period_ns <= 50_000


def test_a_loop_that_is_silent_is_not_waited_for() -> None:
    for ended_ns in (0, NOW_NS - 11 * MS):
        assert pause_ns(ended_ns, MS, 20 * MS) == 20 * MS
