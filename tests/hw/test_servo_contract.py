"""Our buses of 1, 2 and 6 servos, simulated and emulated, keep the contract of ``Bus``."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import pytest

from haptic_wall.hw.clock import Clock, SimulatedClock
from haptic_wall.hw.errors import ServoError
from haptic_wall.hw.open import open_bus
from haptic_wall.hw.servo import Bus, Check, Outcome, Reading
from haptic_wall.hw.settings import ServoSettings
from haptic_wall.hw.simulated import SimulatedBus
from haptic_wall.hw.truth import TrueServo

PERIOD_NS = 1_000_000
TRUE = TrueServo(inertia=0.012, damping=0.012, coulomb=0.09)
EMULATED = ServoSettings(baud=4_000_000, model="XM430-W350", probe_torque=0.0, backend="dynamixel")
LOADED = TrueServo(
    inertia=0.012,
    damping=0.012,
    coulomb=0.09,
    delay=0.4e-3,
    load_inertia=0.003,
    transmission_stiffness=2000.0,
    transmission_damping=1.0,  # so much that nothing vibrates after the stop
)
WITHOUT_ENCODER = TrueServo(inertia=0.012, counts_per_rev=0)


@dataclass
class Rig:
    """Servos at rest near 0 rad, not started, and the clock they run on."""

    bus: Bus
    clock: Clock
    period_ns: int = 1_000_000
    """From one cycle to the next [ns]; a reply has half of it"""
    push: float = 0.5
    """A torque that turns a shaft by more than 0.01 rad in 100 periods, and back in 300 [N·m]"""

    def write(self, torque: float) -> Sequence[float]:
        """Send the same torque to all; the torques really sent [N·m]."""
        return self.bus.write([torque] * len(self.bus.facts))

    def cycle(self, torque: float) -> tuple[Sequence[Reading], Sequence[float]]:
        """One period: the readings, and the torques really sent [N·m]."""
        start_ns = self.clock.now_ns()
        self.bus.request()
        readings = self.bus.collect(start_ns + self.period_ns // 2)
        sent = self.write(torque)
        self.clock.wait_until(start_ns + self.period_ns)
        assert len(readings) == len(sent) == len(self.bus.facts)
        return readings, sent

    def positions(self, torque: float = 0.0) -> list[float]:
        """One period: the positions [rad]."""
        return [reading.position for reading in self.cycle(torque)[0]]


class BusContract:
    """The contract; a class derived from it is a test class."""

    def make_rig(self) -> Rig:
        """Make a bus that has nothing in common with any other; it is closed after the test."""
        raise NotImplementedError("derive a class from BusContract that makes the bus")

    @pytest.fixture
    def rig(self) -> Iterator[Rig]:
        """A fresh one."""
        rig = self.make_rig()
        yield rig
        rig.bus.close()

    def test_starting_reports_checks_that_all_hold(self, rig: Rig) -> None:
        found = rig.bus.start()
        assert len(found) == len(rig.bus.facts)
        for checks in found:
            assert all(isinstance(check, Check) and check.ok for check in checks)

    def test_every_cycle_gives_positions_sampled_within_it(self, rig: Rig) -> None:
        rig.bus.start()
        before = -math.inf
        for _ in range(50):
            start_ns = rig.clock.now_ns()
            readings, _ = rig.cycle(0.0)
            for reading in readings:
                assert reading.outcome is Outcome.OK
                assert math.isfinite(reading.position)
                assert start_ns <= reading.sampled_ns <= rig.clock.now_ns()
                assert reading.sampled_ns > before
                assert reading.alert is False
            before = readings[-1].sampled_ns

    def test_a_position_is_the_count_it_was_read_from(self, rig: Rig) -> None:
        rig.bus.start()
        for _ in range(100):
            for reading, facts in zip(rig.cycle(0.8 * rig.push)[0], rig.bus.facts, strict=True):
                if facts.counts_per_rev:
                    angle = reading.counts * math.tau / facts.counts_per_rev
                    assert reading.position == pytest.approx(angle, rel=1e-12)
                else:
                    assert reading.counts == 0

    def test_a_positive_torque_moves_it_up_and_a_negative_one_down(self, rig: Rig) -> None:
        rig.bus.start()
        start = rig.positions()
        up = [rig.positions(rig.push) for _ in range(100)][-1]
        down = [rig.positions(-rig.push) for _ in range(300)][-1]
        for first, highest, last in zip(start, up, down, strict=True):
            assert highest > first + 0.01
            assert last < highest - 0.01

    def test_torques_are_sent_limited_and_rounded(self, rig: Rig) -> None:
        rig.bus.start()
        for wanted in (0.0, 0.03, -0.03, 1e6, -1e6):
            sent = rig.cycle(wanted)[1]
            for torque, facts in zip(sent, rig.bus.facts, strict=True):
                assert abs(torque) <= facts.torque_limit
                possible = max(-facts.torque_limit, min(facts.torque_limit, wanted))
                rounding = 1.0 if abs(wanted) > 1.0 else 0.5
                assert torque == pytest.approx(possible, abs=rounding * facts.torque_step + 1e-12)

    def test_rounding_keeps_to_a_limit_that_the_servo_can_give(self, rig: Rig) -> None:
        rig.bus.start()
        for most in (0.0301, 0.0339, 0.2):
            wanted = [facts.within(most) for facts in rig.bus.facts]
            for torque, facts in zip(rig.bus.write(wanted), rig.bus.facts, strict=True):
                assert most - facts.torque_step - 1e-12 < torque <= most + 1e-9

    @pytest.mark.parametrize("torque", [math.nan, math.inf, -math.inf])
    def test_a_torque_that_is_no_number_is_refused_and_changes_nothing(
        self, rig: Rig, torque: float
    ) -> None:
        rig.bus.start()
        start = rig.positions()
        with pytest.raises(ValueError, match="torque"):
            rig.bus.write([0.0] * (len(rig.bus.facts) - 1) + [torque])
        for _ in range(20):
            assert rig.positions() == pytest.approx(start, abs=0.01)

    def test_a_request_may_be_collected_in_the_next_period(self, rig: Rig) -> None:
        rig.bus.start()
        rig.bus.request()
        requested_ns = rig.clock.now_ns()
        for _ in range(20):
            rig.clock.wait_until(requested_ns + rig.period_ns)
            for reading in rig.bus.collect(rig.clock.now_ns() + rig.period_ns // 2):
                assert reading.outcome is Outcome.OK
                assert reading.sampled_ns <= requested_ns
            rig.write(0.0)
            rig.bus.request()
            requested_ns = rig.clock.now_ns()

    def test_no_torque_is_taken_before_the_start_or_after_the_stop(self, rig: Rig) -> None:
        with pytest.raises((RuntimeError, ServoError)):
            rig.write(0.2 * rig.push)
        rig.bus.start()
        rig.write(0.0)
        assert rig.bus.stop() is True
        with pytest.raises((RuntimeError, ServoError)):
            rig.write(0.2 * rig.push)

    def test_stopping_is_safe_at_any_time_and_twice(self, rig: Rig) -> None:
        rig.bus.stop()
        rig.bus.start()
        rig.cycle(rig.push)
        assert rig.bus.stop() is True
        assert rig.bus.stop() is True

    def test_after_the_stop_nothing_pushes_any_more(self, rig: Rig) -> None:
        rig.bus.start()
        for _ in range(20):
            rig.cycle(rig.push)
        rig.bus.stop()
        rig.clock.wait_until(rig.clock.now_ns() + 5 * rig.period_ns)  # what is under way arrives
        positions = []
        for _ in range(10):
            now_ns = rig.clock.now_ns()
            rig.bus.request()
            found = rig.bus.collect(now_ns + rig.period_ns // 2)
            positions.append([reading.position for reading in found])
            rig.clock.wait_until(now_ns + 10 * rig.period_ns)
        for path, facts in zip(zip(*positions, strict=True), rig.bus.facts, strict=True):
            speeds = [after - before for before, after in itertools.pairwise(path)]
            for earlier, later in itertools.pairwise(speeds):
                assert later <= earlier + 1.01 * (facts.position_step or 1e-12)

    def test_closing_stops_it_first_and_is_safe_twice(self, rig: Rig) -> None:
        rig.bus.start()
        rig.cycle(rig.push)
        rig.bus.close()
        with pytest.raises((RuntimeError, ServoError)):
            rig.write(0.2 * rig.push)
        rig.bus.close()

    def test_it_says_what_it_is(self, rig: Rig) -> None:
        for facts in rig.bus.facts:
            assert facts.name
            assert facts.torque_limit > 0.0
            assert facts.torque_step >= 0.0
            assert facts.counts_per_rev >= 0

    def test_on_a_good_bus_cycles_are_counted_and_none_is_lost(self, rig: Rig) -> None:
        traffic = rig.bus.traffic
        rig.bus.start()
        for _ in range(10):
            rig.cycle(0.0)
        assert rig.bus.traffic is traffic, "the loop keeps the object"
        if traffic is None:
            return
        assert len(traffic.counts) == len(rig.bus.facts)
        for counts in traffic.counts:
            assert counts.cycles == 10
            assert (counts.lost, counts.late, counts.corrupt) == (0, 0, 0)
        assert 0 <= traffic.waited_ns < rig.period_ns
        rig.bus.stop()
        rig.bus.start()
        assert traffic.counts[0].cycles == 0, "they begin anew with each start"


class TestSimulated(BusContract):
    trues: tuple[TrueServo, ...] = (replace(TRUE, torque_step=0.0013, delay=0.4e-3),)
    """The largest torque is no whole number of steps"""

    def make_rig(self) -> Rig:
        clock = SimulatedClock(start_ns=7 * PERIOD_NS)
        return Rig(SimulatedBus(self.trues, clock), clock)


class TestSimulatedTwoWithALoadAndWithoutEncoder(TestSimulated):
    trues = (LOADED, WITHOUT_ENCODER)


@pytest.mark.whole
class TestSimulatedSix(TestSimulated):
    trues = (*TestSimulated.trues, LOADED, WITHOUT_ENCODER) * 2


class TestEmulated(BusContract):
    trues: tuple[TrueServo, ...] = (TRUE,)

    def make_rig(self) -> Rig:
        clock = SimulatedClock(start_ns=7 * PERIOD_NS)
        period_ns = PERIOD_NS if len(self.trues) < 6 else 2 * PERIOD_NS  # their replies take long
        servos = [replace(EMULATED, id=n, true=true) for n, true in enumerate(self.trues, start=1)]
        return Rig(open_bus(servos, clock), clock, period_ns)


class TestEmulatedTwoWithALoad(TestEmulated):
    trues = (TRUE, LOADED)


@pytest.mark.whole
class TestEmulatedSix(TestEmulated):
    trues = (TRUE,) * 6
