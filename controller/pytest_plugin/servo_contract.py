"""Tests a servo backend against the contract of the ``Servo`` interface.

A backend's own tests derive a class from ``ServoContract`` and say how one of its servos is made,
simulated or emulated: the tests turn the shaft. Not imported by the plugin itself.

    class TestMine(ServoContract):
        def make_rig(self):
            clock = SimulatedClock()
            return Rig(MyServo(..., clock), clock)
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from haptic_wall.hw.clock import Clock
from haptic_wall.hw.errors import ServoError
from haptic_wall.hw.servo import Check, Outcome, Reading, Servo


@dataclass
class Rig:
    """A servo at rest near 0 rad, not started, and the clock it runs on."""

    servo: Servo
    clock: Clock
    period_ns: int = 1_000_000
    """From one cycle to the next [ns]; a reply has half of it"""
    push: float = 0.5
    """A torque that turns the shaft by more than 0.01 rad in 100 periods, and back in 300 [N·m]"""

    def cycle(self, torque: float) -> tuple[Reading, float]:
        """One period: the reading, and the torque really sent [N·m]."""
        start_ns = self.clock.now_ns()
        self.servo.request()
        reading = self.servo.collect(start_ns + self.period_ns // 2)
        sent = self.servo.write(torque)
        self.clock.wait_until(start_ns + self.period_ns)
        return reading, sent


class ServoContract:
    """The contract; a class derived from it is a test class."""

    def make_rig(self) -> Rig:
        """Make a servo that has nothing in common with any other; it is closed after the test."""
        raise NotImplementedError("derive a class from ServoContract that makes the servo")

    @pytest.fixture
    def rig(self) -> Iterator[Rig]:
        """A fresh one."""
        rig = self.make_rig()
        yield rig
        rig.servo.close()

    def test_starting_reports_checks_that_all_hold(self, rig: Rig) -> None:
        checks = rig.servo.start()
        assert all(isinstance(check, Check) and check.ok for check in checks)

    def test_every_cycle_gives_a_position_sampled_within_it(self, rig: Rig) -> None:
        rig.servo.start()
        before = -math.inf
        for _ in range(50):
            start_ns = rig.clock.now_ns()
            reading, _ = rig.cycle(0.0)
            assert reading.outcome is Outcome.OK
            assert math.isfinite(reading.position)
            assert start_ns <= reading.sampled_ns <= rig.clock.now_ns()
            assert reading.sampled_ns > before
            assert reading.alert is False
            before = reading.sampled_ns

    def test_the_position_is_the_count_it_was_read_from(self, rig: Rig) -> None:
        rig.servo.start()
        counts_per_rev = rig.servo.facts.counts_per_rev
        for _ in range(100):
            reading, _ = rig.cycle(0.8 * rig.push)
            if counts_per_rev:
                angle = reading.counts * math.tau / counts_per_rev
                assert reading.position == pytest.approx(angle, rel=1e-12)
            else:
                assert reading.counts == 0

    def test_a_positive_torque_moves_it_up_and_a_negative_one_down(self, rig: Rig) -> None:
        rig.servo.start()
        start = up = rig.cycle(0.0)[0].position
        for _ in range(100):
            up = rig.cycle(rig.push)[0].position
        assert up > start + 0.01
        down = up
        for _ in range(300):
            down = rig.cycle(-rig.push)[0].position
        assert down < up - 0.01

    def test_a_torque_is_sent_limited_and_rounded(self, rig: Rig) -> None:
        rig.servo.start()
        facts = rig.servo.facts
        small = 0.0301 * facts.torque_limit
        for wanted in (0.0, small, -small):
            tolerance = 0.5 * facts.torque_step + 1e-12
            assert rig.cycle(wanted)[1] == pytest.approx(wanted, abs=tolerance)
        for wanted in (1e6, -1e6):
            sent = rig.cycle(wanted)[1]
            assert abs(sent) <= facts.torque_limit
            most = math.copysign(facts.torque_limit, wanted)
            assert sent == pytest.approx(most, abs=facts.torque_step + 1e-12)

    @pytest.mark.parametrize("torque", [math.nan, math.inf, -math.inf])
    def test_a_torque_that_is_no_number_is_refused_and_changes_nothing(
        self, rig: Rig, torque: float
    ) -> None:
        rig.servo.start()
        start = rig.cycle(0.0)[0].position
        with pytest.raises(ValueError, match="torque"):
            rig.servo.write(torque)
        for _ in range(20):
            reading, _ = rig.cycle(0.0)
            assert reading.position == pytest.approx(start, abs=0.01)

    def test_a_request_may_be_collected_in_the_next_period(self, rig: Rig) -> None:
        rig.servo.start()
        rig.servo.request()
        requested_ns = rig.clock.now_ns()
        for _ in range(20):
            rig.clock.wait_until(requested_ns + rig.period_ns)
            reading = rig.servo.collect(rig.clock.now_ns() + rig.period_ns // 2)
            assert reading.outcome is Outcome.OK
            assert reading.sampled_ns <= requested_ns
            rig.servo.write(0.0)
            rig.servo.request()
            requested_ns = rig.clock.now_ns()

    def test_no_torque_is_taken_before_the_start_or_after_the_stop(self, rig: Rig) -> None:
        with pytest.raises((RuntimeError, ServoError)):
            rig.servo.write(0.2 * rig.push)
        rig.servo.start()
        rig.servo.write(0.0)
        assert rig.servo.stop() is True
        with pytest.raises((RuntimeError, ServoError)):
            rig.servo.write(0.2 * rig.push)

    def test_stopping_is_safe_at_any_time_and_twice(self, rig: Rig) -> None:
        rig.servo.stop()
        rig.servo.start()
        rig.cycle(rig.push)
        assert rig.servo.stop() is True
        assert rig.servo.stop() is True

    def test_after_the_stop_nothing_pushes_any_more(self, rig: Rig) -> None:
        rig.servo.start()
        for _ in range(20):
            rig.cycle(rig.push)
        rig.servo.stop()
        rig.clock.wait_until(rig.clock.now_ns() + 5 * rig.period_ns)  # what is under way arrives
        positions = []
        for _ in range(10):
            now_ns = rig.clock.now_ns()
            rig.servo.request()
            positions.append(rig.servo.collect(now_ns + rig.period_ns // 2).position)
            rig.clock.wait_until(now_ns + 10 * rig.period_ns)
        speeds = [after - before for before, after in itertools.pairwise(positions)]
        rounding = rig.servo.facts.position_step or 1e-12
        for earlier, later in itertools.pairwise(speeds):
            assert later <= earlier + 1.01 * rounding

    def test_closing_stops_it_first_and_is_safe_twice(self, rig: Rig) -> None:
        rig.servo.start()
        rig.cycle(0.6 * rig.push)
        rig.servo.close()
        with pytest.raises((RuntimeError, ServoError)):
            rig.servo.write(0.2 * rig.push)
        rig.servo.close()

    def test_it_says_what_it_is(self, rig: Rig) -> None:
        facts = rig.servo.facts
        assert facts.name
        assert facts.torque_limit > 0.0
        assert facts.torque_step >= 0.0
        assert facts.counts_per_rev >= 0

    def test_on_a_good_bus_cycles_are_counted_and_none_is_lost(self, rig: Rig) -> None:
        bus = rig.servo.bus
        rig.servo.start()
        for _ in range(10):
            rig.cycle(0.0)
        assert rig.servo.bus is bus, "the loop keeps the object"
        if bus is None:
            return
        counts = bus.counts
        assert counts.cycles == 10
        assert (counts.lost, counts.late, counts.corrupt, counts.refused) == (0, 0, 0, 0)
        assert 0 <= bus.waited_ns < rig.period_ns
        assert bus.reply_s >= 0.0
        rig.servo.stop()
        rig.servo.start()
        assert bus.counts.cycles == 0, "they begin anew with each start"
