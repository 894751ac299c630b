"""A position a period, its velocity over the time that really passed, and what a failure leaves."""

from typing import cast

import pytest

from haptic_wall.controller.laws.velocity import BackwardDifference
from haptic_wall.controller.runtime.sampler import Sampler
from haptic_wall.hw.servo import Outcome, Reading, Servo

PERIOD_NS = 1_000_000


class Replies:
    """A servo that gives the replies it was told to, and notes what it was asked."""

    def __init__(self, *replies: Reading) -> None:
        self.replies = list(replies)
        self.requests = 0
        self.deadlines: list[int] = []

    def request(self) -> None:
        self.requests += 1

    def collect(self, deadline_ns: int) -> Reading:
        self.deadlines.append(deadline_ns)
        return self.replies.pop(0)


def good(position: float, at_ns: int) -> Reading:
    return Reading(Outcome.OK, position, 0, at_ns, 0.1, False)


def sampler(*replies: Reading, pipelined: bool = False) -> tuple[Sampler, Replies]:
    servo = Replies(*replies)
    made = Sampler(cast(Servo, servo), BackwardDifference(1e-3), PERIOD_NS, pipelined=pipelined)
    return made, servo


@pytest.mark.parametrize(
    ("passed", "counted"),
    [(0.2, 0.5), (0.95, 1.0), (1.05, 1.0), (1.5, 1.5), (2.93, 3.0), (3.4, 3.4)],
)
def test_the_velocity_is_over_the_time_that_really_passed(passed: float, counted: float) -> None:
    made, _ = sampler(good(0.0, 10), good(0.01, 10 + round(passed * PERIOD_NS)))
    made.sample(0)
    made.sample(PERIOD_NS)
    assert made.velocity == pytest.approx(0.01 / (counted * 1e-3))
