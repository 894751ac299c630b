"""What comes from outside ends the run by its own name, and explains trips that look like it."""

import pytest

from haptic_wall.controller.processes.outside import Outside
from haptic_wall.controller.runtime.safety import End, Trip
from haptic_wall.hw.clock import SimulatedClock

SECOND_NS = 1_000_000_000


class Users:
    def __init__(self) -> None:
        self.now = self.everywhere = ""

    def look(self) -> str:
        return self.now

    def look_everywhere(self) -> str:
        return self.everywhere


class Stage:
    def __init__(self, real: bool = True) -> None:
        self.clock = SimulatedClock(SECOND_NS)
        self.outside = Outside(self.clock, real)
        self.outside.users = self.users = Users()


@pytest.fixture
def stage() -> Stage:
    return Stage()


def test_a_suspended_computer_ends_the_run(stage: Stage) -> None:
    stage.clock.suspended_ns += 3 * SECOND_NS
    assert stage.outside.look()
    words = "the computer was suspended for 3 s"
    assert stage.outside.verdict(End.INTERRUPTED) == ("trip:suspended", words)


@pytest.mark.parametrize("noticed", [True, False])
@pytest.mark.parametrize(
    "trip", ["torque_lost", "servo_lost", "loop_hung", "losses_in_row", "loss_rate", "overspeed"]
)
def test_it_wins_over_what_loop_and_servo_make_of_it(
    stage: Stage, trip: str, noticed: bool
) -> None:
    stage.users.now = stage.users.everywhere = "minicom (pid 7) has opened /dev/ttyUSB0"
    stage.clock.suspended_ns += 3 * SECOND_NS
    if noticed:
        assert stage.outside.look()
    reason, text = stage.outside.verdict(Trip(f"trip:{trip}"))
    assert reason == "trip:suspended"
    assert text == f"the computer was suspended for 3 s; the run had ended by {trip}"


def test_another_program_ends_the_run_by_name(stage: Stage) -> None:
    stage.users.now = "minicom (pid 7) has opened /dev/ttyUSB0"
    assert stage.outside.look()
    stage.users.now = ""  # gone by the time the run is over
    assert stage.outside.verdict(End.INTERRUPTED) == (
        "trip:port_shared",
        "minicom (pid 7) has opened /dev/ttyUSB0",
    )
