"""Trips come when they must, and not before."""

import math
from dataclasses import replace

import pytest

from haptic_wall.controller.runtime.checks import Safety, SafetyLimits
from haptic_wall.controller.runtime.safety import EXPLANATIONS, Trip

MS = 1_000_000
LIMITS = SafetyLimits(
    max_speed=10.0,
    position_step=0.0015,
    max_loss=0.5,
    loss_window=100,
    max_silence_ns=15 * MS,
    period_ns=MS,
)
FEW = replace(LIMITS, max_loss=0.05)


def reading(position: float, at_ms: int, alert: bool = False) -> tuple[float, int, bool]:
    return position, at_ms * 1_000_000, alert


def test_a_jump_trips_and_the_first_reading_is_none() -> None:
    safety = Safety(LIMITS)
    assert safety.good(*reading(500.0, 1)) is None
    assert safety.good(*reading(500.02, 2)) is Trip.OVERSPEED


def test_the_encoders_rounding_is_no_speed() -> None:
    safety = Safety(LIMITS)
    safety.good(*reading(0.0, 1))
    assert safety.good(*reading(0.0099 + 2 * 0.0015, 2)) is None
    assert safety.good(*reading(0.0129 + 0.0132, 3)) is Trip.OVERSPEED


def test_not_a_number_and_alert_trip() -> None:
    assert Safety(LIMITS).good(*reading(math.nan, 1)) is Trip.NOT_A_NUMBER
    assert Safety(LIMITS).good(*reading(math.inf, 1)) is Trip.NOT_A_NUMBER
    assert Safety(LIMITS).good(*reading(0.0, 1, alert=True)) is Trip.HARDWARE_ERROR


def silent(safety: Safety, period_ms: float) -> tuple[object, int]:
    """From a good reading on all fail: when that trips, after so many [ms], and how many did."""
    safety.good(*reading(0.0, 1000))
    for count in range(1, 1000):
        after_ms = (count + 0.8) * period_ms
        if safety.failed(1000 * MS + round(after_ms * MS)) is Trip.LOSSES_IN_ROW:
            return after_ms, count
    raise AssertionError("it never trips")


def test_a_silence_is_a_time_not_a_count() -> None:
    assert silent(Safety(LIMITS), 1.0) == (pytest.approx(15.8), 15)
    assert silent(Safety(LIMITS), 0.5) == (pytest.approx(15.4), 30)
    assert silent(Safety(LIMITS), 4.0) == (pytest.approx(15.2), 3)


@pytest.mark.parametrize("period_ms", [10.0, 20.0])
def test_at_low_rates_three_readings_must_fail(period_ms: float) -> None:
    assert silent(Safety(replace(LIMITS, max_loss=1.0)), period_ms)[1] == 3


def test_a_stall_of_the_loop_itself_is_no_silence_of_the_bus() -> None:
    safety = Safety(LIMITS)
    safety.good(*reading(0.0, 1000))
    assert safety.failed(1030 * MS) is None, "one reading was lost, whenever it was asked for"
    assert safety.failed(1031 * MS) is None
    assert safety.failed(1032 * MS) is Trip.LOSSES_IN_ROW


def test_loss_rate_over_the_window() -> None:
    safety = Safety(FEW)
    trips = []
    for k in range(200):  # one in ten is twice the allowed share
        trips.append(safety.failed(k * MS) if k % 10 == 0 else safety.good(*reading(0.0, k)))
    assert trips.index(Trip.LOSS_RATE) == 50, "the sixth loss within a hundred readings"
    safety = Safety(FEW)
    for k in range(2000):  # one in twenty-five for ever is allowed
        assert (safety.failed(k * MS) if k % 25 == 0 else safety.good(*reading(0.0, k))) is None


def test_the_value_that_trips_and_its_limit_are_told() -> None:
    safety = Safety(LIMITS)
    silent(safety, 1.0)
    assert safety.found == "15.8 ms without a reading; at most 15 ms is allowed"
    safety = Safety(FEW)
    assert [safety.failed(0) for _ in range(6)][-1] is Trip.LOSS_RATE
    assert safety.found == "6.0% of the readings; at most 5.0% is allowed"
    safety = Safety(LIMITS)
    safety.good(*reading(1.0, 1))
    assert [safety.found] == [""]
    safety.good(*reading(0.9, 5))
    assert safety.found == "25 rad/s between two readings; at most 10 is allowed"
    safety.good(*reading(1.0, 5))
    assert safety.found.startswith("inf rad/s"), "two readings of one instant"
    safety = Safety(replace(LIMITS, travel=(-1.0, 2.0)))
    safety.good(*reading(2.5, 1))
    assert safety.found == "2.5 rad; allowed is -1 to 2"


def test_every_trip_is_explained() -> None:
    assert set(EXPLANATIONS) == set(Trip)


def test_travel_counts_turns_and_trips_at_once_beyond_its_ends() -> None:
    for low, high, ends in ((-1.0, 20.0, True), (-1.0, 6.0, False)):
        safety = Safety(replace(LIMITS, travel=(low, high), max_speed=1e6))
        assert safety.good(*reading(0.0, 1)) is None
        found = safety.good(*reading(3 * math.tau, 2))
        assert found is (None if ends else Trip.TRAVEL)
    safety = Safety(replace(LIMITS, travel=(-1.0, 1.0)))
    assert safety.good(*reading(-1.001, 1)) is Trip.TRAVEL, "at the first reading too"


def test_travel_from_the_start_counts_from_the_first_good_reading() -> None:
    safety = Safety(replace(LIMITS, travel=(-0.1, 0.1), travel_from_start=True))
    safety.failed(0)
    assert safety.good(*reading(50.0, 1)) is None
    assert safety.good(*reading(50.05, 7)) is None
    assert safety.good(*reading(50.099, 13)) is None
    assert safety.good(*reading(50.101, 19)) is Trip.TRAVEL


def test_missed_periods_are_counted_over_half_a_second() -> None:
    safety = Safety(replace(LIMITS, max_missed=0.2))
    few = [safety.missed(k * 10 * MS, 2) for k in range(1000)]
    assert set(few) == {None}, "a fifth, and no more"
    more = [safety.missed(10**10 + k * 10 * MS, 3) for k in range(50)]
    assert more[-1] is Trip.MISSED_PERIODS
    assert safety.found == "30.0% of the periods of 0.5 s; at most 20% is allowed"
    assert safety.worst_missed == 0.3
