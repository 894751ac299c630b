"""A change that is asked for before the servo has been started."""

import time
from collections.abc import Iterator
from typing import Any

import pytest

from haptic_wall.controller.live import change_desk as module
from haptic_wall.controller.live.change_desk import ChangeDesk
from haptic_wall.controller.runtime.handover import Inbox, KnownServo, Offers
from haptic_wall.controller.runtime.safety import REASONS, Trip
from haptic_wall.controller.runtime.telemetry import LoopState, Telemetry, Word
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.servo import Facts

NOT_YET = "the servo has not been started yet"


class Side:
    """A desk, and the loop's side, of a run with these axes."""

    def __init__(self, axes: int = 1, *sets: str) -> None:
        self.telemetry = Telemetry.create(axes)
        self.inbox, self.told = Inbox(self.telemetry), list[dict[str, Any]]()
        config = load_config("simulated", ("servo.hand=none", *sets)).config
        self.desk = ChangeDesk(config, self.telemetry, Offers(self.telemetry), self.told.append)

    def begin(self, wait_s: float) -> dict[str, Any] | None:
        return self.desk.begin(["wall.stiffness=1"], wait_s)

    def start(self) -> None:
        """Start the servos."""
        known = KnownServo(Facts("a servo", 4096, 4.1, 0.0), None, True)
        self.inbox.tell([known] * self.telemetry.axes)
        self.telemetry.words[Word.STATE] = LoopState.RUNNING


@pytest.fixture
def side() -> Iterator[Side]:
    made = Side()
    yield made
    made.telemetry.close()


@pytest.fixture
def arm() -> Iterator[Side]:
    """Of two axes, whose servos have started."""
    made = Side(2, "axes={arm: {}, elbow: {wall: {stiffness: 4}}}")
    made.start()
    yield made
    made.telemetry.close()


def test_a_change_is_of_the_wall_of_one_axis(arm: Side) -> None:
    desk, inbox = arm.desk, arm.inbox
    no_wall = "no change of the wall of one axis"
    for wrong, found in (
        (["wall.stiffness=3"], no_wall),
        (["axes.arm.delay.steps=2"], no_wall),
        (["axes.arm.wall.damping=0", "axes.elbow.wall.damping=0"], "changes of 2 axes"),
        (["axes.elbwo.wall.damping=0"], "no axis elbwo (did you mean elbow?)"),
    ):
        answer = desk.begin(wrong, 1.0)
        assert answer is not None
        assert f"found {found}, wanted" in answer["error"]
        assert "NAME is one of arm, elbow" in answer["error"]
    answer = desk.begin(["axes.elbow.wall.stiffness=-1"], 1.0)
    assert answer is not None and answer["field"] == "axes.elbow.wall.stiffness"
    assert answer["error"].startswith("refused: axes.elbow.wall.stiffness: found -1")
    assert desk.begin(["axes.elbow.wall.stiffness=3"], 1.0) is None
    change = inbox.take()
    assert change is not None and change.axis == 1
    assert change.table.at(0).stiffness == 3.0
    inbox.settle(0, 0)
    answer = desk.look()
    assert answer is not None and answer["changed"] == {"axes.elbow.wall.stiffness": 3.0}


def test_it_waits_for_the_start_and_says_so(side: Side) -> None:
    assert side.begin(60.0) is None
    assert side.desk.look() is None and side.desk.obstacle() == NOT_YET
    side.start()
    assert side.desk.look() is None and side.desk.obstacle() == ""
    offered = side.telemetry.words[Word.OFFERED]
    assert offered > 0, "the loop gets it"
    while side.inbox.change is None:
        side.inbox.take()
    side.inbox.settle(0, 0)
    answer = side.desk.look()
    assert answer is not None and answer["applied"]
    assert answer["changed"] == {"wall.stiffness": 1.0}


def test_it_is_not_made_where_the_start_takes_too_long(
    side: Side, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "START_S", 0.0)
    assert side.begin(0.0) is None
    time.sleep(1e-3)
    answer = side.desk.look()
    assert answer is not None and answer["error"] == f"not applied: {NOT_YET}"
    assert [each["outcome"] for each in side.told] == ["not applied"]
    assert side.desk.look() is None


def test_it_is_given_up_with_whoever_asked(side: Side) -> None:
    assert side.begin(60.0) is None
    side.desk.withdraw()
    side.start()
    answer = side.desk.look()
    assert answer is not None and answer["error"].startswith("not applied: ")
    assert side.telemetry.words[Word.OFFERED] == 0
    assert side.begin(60.0) is None
    assert side.desk.give_up()["error"] == "not applied: the run is over"


def test_a_change_of_a_run_that_an_axis_ends_is_told_why(arm: Side) -> None:
    """The loop settles the change of an axis that has tripped a moment before it tells why."""
    desk, inbox, words = arm.desk, arm.inbox, arm.telemetry.words
    for tripped in (False, True):
        words[Word.STATE], words[Word.REASON], words[Word.STOP_AXIS] = LoopState.RUNNING, 0, 0
        assert desk.begin(["axes.arm.wall.stiffness=3"], 60.0) is None
        if tripped:
            inbox.change = None
            inbox.take()
            inbox.settle(-1, 0)
        assert desk.look() is None
        words[Word.STOP_AXIS], words[Word.REASON] = 2, 1 + REASONS.index(Trip.OSCILLATION)
        words[Word.STATE] = LoopState.STOPPING
        if not tripped:
            assert desk.look() is None
            inbox.take()
            inbox.settle(-1, 0)
        answer = desk.look() or desk.look()
        assert answer is not None
        assert answer["error"] == "not applied: the run is over: trip:oscillation of elbow"
