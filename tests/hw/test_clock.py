"""The computer's suspension is what one clock counts and the other does not."""

import pytest

from haptic_wall.hw.clock import MonotonicClock, SimulatedClock, Suspension


class Paused(SimulatedClock):
    """Each look at a clock takes a while, as when the process is held up in between."""

    def now_ns(self) -> int:
        self.wait_until(super().now_ns() + 50_000_000)
        return super().now_ns()

    def boot_ns(self) -> int:
        self.now_ns()
        return super().boot_ns()


@pytest.mark.parametrize("clock", [SimulatedClock(), MonotonicClock()])
def test_time_that_passes_is_no_suspension(clock: MonotonicClock | SimulatedClock) -> None:
    suspension = Suspension(clock)
    clock.wait_until(clock.now_ns() + 1_000_000)
    assert suspension.seconds() == 0.0


def test_what_came_before_does_not_count() -> None:
    clock = SimulatedClock(5)
    clock.suspended_ns = 7_000_000_000
    suspension = Suspension(clock)
    assert suspension.seconds() == 0.0
    clock.suspended_ns += 2_000_000_000
    assert suspension.seconds() == pytest.approx(2.0)


def test_a_pause_between_two_clocks_is_no_suspension() -> None:
    suspension = Suspension(Paused())
    for _ in range(10):
        assert suspension.seconds() == 0.0
