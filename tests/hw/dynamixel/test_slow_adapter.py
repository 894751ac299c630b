"""An adapter that keeps replies back for longer than the schedules allow: a start refuses it.

The real driver on an emulated bus in memory behind an adapter's latency timer.
"""

from __future__ import annotations

import pytest

from haptic_wall.hw.errors import UnfitServoError
from tests.hw.dynamixel.bench import Bench


def behind(timer_ms: float, period_ms: float = 1.0, phase_ms: float = 0.35) -> Bench:
    """A servo behind an adapter with a latency timer, not started."""
    period_s = period_ms * 1e-3
    return Bench(timer_ms=timer_ms, phase_ms=phase_ms, period_s=period_s, probe_torque=0.0)


@pytest.mark.parametrize(
    ("timer_ms", "period_ms"), [(16, 1.0), (16, 8.0), (2, 1.0), (1, 0.5), (4, 2.0)]
)
@pytest.mark.parametrize("phase_ms", [0.35, 0.0, 15.95])
def test_replies_that_take_more_than_1_8_periods_are_refused_with_the_torque_off(
    timer_ms: float, period_ms: float, phase_ms: float
) -> None:
    slow = behind(timer_ms, period_ms, phase_ms)
    with pytest.raises(UnfitServoError) as refusal:
        slow.servo.start()
    told = str(refusal.value)
    assert f"Its replies take {timer_ms:.1f} ms, more than 1.8 periods" in told
    assert "latency timer to 1 ms" in told and "lower loop.rate_hz" in told
    assert slow.truth.memory["torque_enable"] == 0
    assert slow.truth.memory["bus_watchdog"] > 0, "it was watched until then"


@pytest.mark.parametrize(("timer_ms", "period_ms"), [(1, 1.0), (16, 10.0), (1, 0.6)])
def test_replies_within_1_8_periods_are_taken(timer_ms: float, period_ms: float) -> None:
    quick = behind(timer_ms, period_ms)
    (check,) = (check for check in quick.servo.start() if check.name == "adapter reply")
    assert check.ok and check.found.startswith(f"{timer_ms:.1f} ms")
    assert check.wanted == f"at most {1.8 * period_ms:.1f} ms"
    assert quick.servo.traffic.longest_s == pytest.approx(timer_ms * 1e-3, abs=2e-4)


def test_a_stalled_machine_at_the_start_makes_no_slow_adapter() -> None:
    """One long reply in three is the machine's: the median is not."""
    stalled = behind(timer_ms=1)
    stalled.bus.inject("late:ms=12,way=reply,every=3", stalled.clock.now_ns())
    (check,) = (check for check in stalled.servo.start() if check.name == "adapter reply")
    assert check.ok
    assert float(check.found.split("longest ")[1].split()[0]) >= 12
