"""A suspended computer ends the run by its own name, and explains trips that look like it."""

import pytest

from haptic_wall.controller.processes.suspension_watch import SuspensionWatch
from haptic_wall.controller.runtime.safety import End, Trip
from haptic_wall.hw.clock import SimulatedClock

SECOND_NS = 1_000_000_000
WORDS = "the computer was suspended for 3 s"


class Stage:
    def __init__(self, real: bool = True) -> None:
        self.clock = SimulatedClock(SECOND_NS)
        self.watch = SuspensionWatch(self.clock, real)

    def suspend(self) -> None:
        self.clock.suspended_ns += 3 * SECOND_NS


def test_it_ends_the_run() -> None:
    stage = Stage()
    assert not stage.watch.look()
    assert stage.watch.verdict(End.INTERRUPTED) == (End.INTERRUPTED, "")
    stage.suspend()
    assert stage.watch.look()
    assert stage.watch.verdict(End.INTERRUPTED) == (Trip.SUSPENDED, WORDS)


@pytest.mark.parametrize(
    "trip", ["torque_lost", "servo_lost", "loop_hung", "losses_in_row", "loss_rate", "overspeed"]
)
def test_it_wins_over_what_loop_and_servo_make_of_it(trip: str) -> None:
    stage = Stage()
    stage.suspend()
    reason, text = stage.watch.verdict(Trip(f"trip:{trip}"))
    assert reason == "trip:suspended"
    assert text == f"{WORDS}; the run had ended by {trip}"


def test_it_explains_a_start_that_failed_and_nothing_that_it_cannot_cause() -> None:
    stage = Stage()
    stage.suspend()
    assert stage.watch.verdict(End.REFUSED) == (End.REFUSED, WORDS)
    assert stage.watch.verdict(Trip.OSCILLATION) == (Trip.OSCILLATION, "")
    assert stage.watch.verdict(End.DURATION) == (End.DURATION, "")


def test_a_run_without_a_real_servo_goes_on_with_a_note() -> None:
    stage = Stage(real=False)
    assert stage.watch.notes() == []
    stage.suspend()
    assert not stage.watch.look()
    assert stage.watch.verdict(Trip.LOOP_HUNG) == (Trip.LOOP_HUNG, "")
    assert stage.watch.notes() == [f"{WORDS} during the run"]
