"""What every servo promises behind the interface, whatever it is made of.

To hold another servo to it, add a function that makes a rig to ``RIGS``.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from haptic_wall.hw.clock import Clock, SimulatedClock
from haptic_wall.hw.errors import ServoError
from haptic_wall.hw.open import open_servo
from haptic_wall.hw.servo import Check, Outcome, Servo
from haptic_wall.hw.settings import ServoSettings, TrueServo
from haptic_wall.hw.simulated import SimulatedServo

PERIOD_NS = 1_000_000


@dataclass
class Rig:
    """A servo at rest near 0 rad, not started, and the clock it runs on."""

    servo: Servo
    clock: Clock


def simulated() -> Rig:
    clock = SimulatedClock(start_ns=7 * PERIOD_NS)
    true = TrueServo(inertia=0.012, damping=0.012, coulomb=0.09, torque_step=0.001, delay=0.4e-3)
    return Rig(SimulatedServo(true, clock), clock)


def simulated_without_encoder() -> Rig:
    clock = SimulatedClock()
    true = TrueServo(inertia=0.012, counts_per_rev=0)
    return Rig(SimulatedServo(true, clock), clock)


def dynamixel_in_memory() -> Rig:
    clock = SimulatedClock(start_ns=7 * PERIOD_NS)
    true = TrueServo(inertia=0.012, damping=0.012, coulomb=0.09)
    settings = ServoSettings("dynamixel", "", 4_000_000, 1, "XM430-W350", true=true)
    return Rig(open_servo(settings, clock), clock)


RIGS: list[Callable[[], Rig]] = [simulated, simulated_without_encoder, dynamixel_in_memory]


@pytest.fixture(params=RIGS, ids=lambda make: make.__name__)
def rig(request):
    rig = request.param()
    yield rig
    rig.servo.close()


def cycle(rig, torque):
    """One period: the reading, and the torque really sent."""
    start_ns = rig.clock.now_ns()
    rig.servo.request()
    reading = rig.servo.collect(start_ns + PERIOD_NS // 2)
    sent = rig.servo.write(torque)
    rig.clock.wait_until(start_ns + PERIOD_NS)
    return reading, sent


def test_starting_reports_checks_that_all_hold(rig):
    checks = rig.servo.start()
    assert all(isinstance(check, Check) and check.ok for check in checks)


def test_every_cycle_gives_a_position_sampled_within_it(rig):
    rig.servo.start()
    before = -math.inf
    for _ in range(50):
        start_ns = rig.clock.now_ns()
        reading, _ = cycle(rig, 0.0)
        assert reading.outcome is Outcome.OK
        assert math.isfinite(reading.position)
        assert start_ns <= reading.sampled_ns <= rig.clock.now_ns()
        assert reading.sampled_ns > before
        assert reading.alert is False
        before = reading.sampled_ns


def test_the_position_is_the_count_it_was_read_from(rig):
    rig.servo.start()
    counts_per_rev = rig.servo.facts.counts_per_rev
    for _ in range(100):
        reading, _ = cycle(rig, 0.4)
        if counts_per_rev:
            angle = reading.counts * 2 * math.pi / counts_per_rev
            assert reading.position == pytest.approx(angle, rel=1e-12)
        else:
            assert reading.counts == 0


def test_a_positive_torque_moves_it_up_and_a_negative_one_down(rig):
    rig.servo.start()
    start = cycle(rig, 0.0)[0].position
    for _ in range(100):
        up = cycle(rig, 0.5)[0].position
    assert up > start + 0.01
    for _ in range(300):
        down = cycle(rig, -0.5)[0].position
    assert down < up - 0.01


def test_a_torque_is_sent_limited_and_rounded(rig):
    rig.servo.start()
    facts = rig.servo.facts
    tolerance = 0.5 * facts.torque_step + 1e-12
    for wanted in (0.0, 0.1234567, -0.1234567):
        assert cycle(rig, wanted)[1] == pytest.approx(wanted, abs=tolerance)
    for wanted in (1e6, -1e6):
        sent = cycle(rig, wanted)[1]
        assert abs(sent) <= facts.torque_limit
        assert sent == pytest.approx(
            math.copysign(facts.torque_limit, wanted), abs=facts.torque_step + 1e-12
        )


@pytest.mark.parametrize("torque", [math.nan, math.inf, -math.inf])
def test_a_torque_that_is_no_number_is_refused_and_changes_nothing(rig, torque):
    rig.servo.start()
    cycle(rig, 0.0)
    with pytest.raises(ValueError, match="torque"):
        rig.servo.write(torque)
    for _ in range(20):
        reading, _ = cycle(rig, 0.0)
        assert math.isfinite(reading.position)
    assert reading.position == pytest.approx(0.0, abs=0.01)


def test_a_request_may_be_collected_in_the_next_period(rig):
    rig.servo.start()
    rig.servo.request()
    requested_ns = rig.clock.now_ns()
    for _ in range(20):
        rig.clock.wait_until(requested_ns + PERIOD_NS)
        reading = rig.servo.collect(rig.clock.now_ns() + PERIOD_NS // 2)
        assert reading.outcome is Outcome.OK
        assert reading.sampled_ns <= requested_ns
        rig.servo.write(0.0)
        rig.servo.request()
        requested_ns = rig.clock.now_ns()


def test_no_torque_is_taken_before_the_start_or_after_the_stop(rig):
    with pytest.raises((RuntimeError, ServoError)):
        rig.servo.write(0.1)
    rig.servo.start()
    rig.servo.write(0.0)
    assert rig.servo.stop() is True
    with pytest.raises((RuntimeError, ServoError)):
        rig.servo.write(0.1)


def test_stopping_is_safe_at_any_time_and_twice(rig):
    rig.servo.stop()
    rig.servo.start()
    cycle(rig, 0.5)
    assert rig.servo.stop() is True
    assert rig.servo.stop() is True


def test_after_the_stop_nothing_pushes_any_more(rig):
    rig.servo.start()
    for _ in range(20):
        cycle(rig, 0.5)
    rig.servo.stop()
    rig.clock.wait_until(rig.clock.now_ns() + 5 * PERIOD_NS)  # what is under way arrives
    positions = []
    for _ in range(10):
        now_ns = rig.clock.now_ns()
        rig.servo.request()
        positions.append(rig.servo.collect(now_ns + PERIOD_NS // 2).position)
        rig.clock.wait_until(now_ns + 10 * PERIOD_NS)
    speeds = [after - before for before, after in itertools.pairwise(positions)]
    counts_per_rev = rig.servo.facts.counts_per_rev
    rounding = 2 * math.pi / counts_per_rev if counts_per_rev else 1e-12
    for earlier, later in itertools.pairwise(speeds):
        assert later <= earlier + 1.01 * rounding


def test_closing_stops_it_first_and_is_safe_twice(rig):
    rig.servo.start()
    cycle(rig, 0.3)
    rig.servo.close()
    with pytest.raises((RuntimeError, ServoError)):
        rig.servo.write(0.1)
    rig.servo.close()


def test_it_says_what_it_is(rig):
    facts = rig.servo.facts
    assert facts.name
    assert facts.torque_limit > 0.0
    assert facts.torque_step >= 0.0
    assert facts.counts_per_rev >= 0


def test_cycles_are_counted_and_none_is_lost_on_a_good_bus(rig):
    rig.servo.start()
    for _ in range(10):
        cycle(rig, 0.0)
    counts = rig.servo.counts
    assert counts.cycles == 10
    assert (counts.lost, counts.late, counts.corrupt) == (0, 0, 0)


@pytest.mark.parametrize("make", RIGS, ids=lambda make: make.__name__)
def test_a_stand_in_takes_the_same_cycles_and_touches_nothing(make):
    alone, beside = make(), make()
    clock = SimulatedClock()
    stand_in = beside.servo.stand_in(clock)  # also of a servo that is not started
    for rig in (alone, beside):
        rig.servo.start()
    extra = Rig(beside.servo.stand_in(clock), clock)
    for number in range(60):
        torque = 0.3 * math.sin(0.2 * number)
        expected = cycle(alone, torque)
        for other in (Rig(stand_in, clock), extra):
            reading, sent = cycle(other, torque)
            assert reading.outcome is Outcome.OK
            assert math.isfinite(reading.position)
            assert not reading.alert
            assert sent == expected[1]
        beside.servo.idle()
        assert cycle(beside, torque) == expected
    assert beside.servo.counts == alone.servo.counts
    assert beside.servo.stop() and alone.servo.stop()
