"""A change while the loop starts, makes it, or ends; the other side acts while the desk waits."""

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Self

import pytest

from haptic_wall.controller.live import change_desk as module
from haptic_wall.controller.live.change_desk import ChangeDesk
from haptic_wall.controller.runtime import handover
from haptic_wall.controller.runtime.handover import Inbox, KnownServo
from haptic_wall.controller.runtime.safety import REASONS, Trip
from haptic_wall.controller.runtime.telemetry import LoopState, Telemetry, Word
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.servo import Facts

NOT_YET = "the servo has not been started yet"


@dataclass
class Side:
    """A desk, and the loop's side."""

    desk: ChangeDesk
    telemetry: Telemetry
    inbox: Inbox
    told: list[dict[str, Any]]
    over: bool = False

    @classmethod
    @contextlib.contextmanager
    def of(cls, *sets: str) -> Iterator[Self]:
        config = load_config("simulated", ("servo.hand=none", "loop.clock=simulated", *sets)).config
        telemetry = Telemetry.create(len(config.each))
        told: list[dict[str, Any]] = []
        desk = ChangeDesk(config, telemetry, told.append, lambda: made.over)
        made = cls(desk, telemetry, Inbox(telemetry), told)
        yield made
        telemetry.close()

    def change(
        self, change: str, *acts: Callable[[], object], gone: bool = False, wait_s: float = 60.0
    ) -> dict[str, Any]:
        """Ask for a change; each time that it waits the other side does the next of the acts."""
        left = [*acts]

        def act(_obstacle: str) -> None:
            left.pop(0)()

        answer = self.desk.change([change], wait_s, act, lambda: gone and not left)
        assert not left
        return answer

    def start(self) -> None:
        """Start the servos."""
        servo = KnownServo(Facts("a servo", 4096, 4.1, 0.0), None)
        self.inbox.tell([servo] * len(self.desk._names))
        self.telemetry.words[Word.STATE] = LoopState.RUNNING

    def settle(self, row: int) -> None:
        """Take the change, and settle it."""
        self.inbox.take()
        self.inbox.settle(row, 0)

    def end(self) -> None:
        """End the run by the second axis."""
        words = self.telemetry.words
        words[Word.STOP_AXIS], words[Word.REASON] = 2, 1 + REASONS.index(Trip.OSCILLATION)
        words[Word.STATE] = LoopState.STOPPING


@pytest.fixture
def side() -> Iterator[Side]:
    with Side.of() as made:
        yield made


@pytest.fixture
def arm() -> Iterator[Side]:
    with Side.of("axes={arm: {}, elbow: {wall: {stiffness: 4}}}") as made:
        made.start()
        yield made


def test_a_change_is_of_the_wall_of_one_axis(arm: Side) -> None:
    no_wall = "no change of the wall of one axis"
    for wrong, found in (
        (["wall.stiffness=3"], no_wall),
        (["axes.arm.delay.steps=2"], no_wall),
        (["axes.arm.wall.damping=0", "axes.elbow.wall.damping=0"], "changes of 2 axes"),
        (["axes.elbwo.wall.damping=0"], "no axis elbwo (did you mean elbow?)"),
    ):
        answer = arm.desk.change(wrong, 1.0, lambda _: None, lambda: False)
        assert f"found {found}, wanted" in answer["error"]
        assert "NAME is one of arm, elbow" in answer["error"]
    answer = arm.change("axes.elbow.wall.stiffness=-1")
    assert answer["field"] == "axes.elbow.wall.stiffness"
    assert answer["error"].startswith("refused: axes.elbow.wall.stiffness: found -1")

    def make() -> None:
        change = arm.inbox.take()
        assert change is not None and change.axis == 1
        assert change.table.at(0).stiffness == 3.0
        arm.inbox.settle(0, 0)

    answer = arm.change("axes.elbow.wall.stiffness=3", make)
    assert answer["changed"] == {"axes.elbow.wall.stiffness": 3.0}


def test_it_waits_for_the_start_and_says_so(side: Side) -> None:
    obstacles: list[str] = []

    def tell_wait(obstacle: str) -> None:
        obstacles.append(obstacle)
        if len(obstacles) == 2:
            side.start()
        elif len(obstacles) == 3:
            side.settle(0)

    answer = side.desk.change(["wall.stiffness=1"], 60.0, tell_wait, lambda: False)
    assert obstacles == [NOT_YET, NOT_YET, ""]
    assert answer["applied"] and answer["changed"] == {"wall.stiffness": 1.0}


def test_it_is_not_made_where_the_start_takes_too_long(
    side: Side, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "START_S", -1.0)
    answer = side.change("wall.stiffness=1", wait_s=-1.0)
    assert answer["error"] == f"not applied: {NOT_YET}"
    assert [each["outcome"] for each in side.told] == ["not applied"]


def test_how_long_it_waited_is_counted_on_the_loops_clock(side: Side) -> None:
    """That clock is late by the time in which loop and emulated bus waited for each other."""
    side.telemetry.words[Word.OFFSET_NS] = 10**12
    side.start()
    answer = side.change("wall.stiffness=1", lambda: time.sleep(0.05), lambda: side.settle(0))
    assert 0.05 <= answer["waited_s"] < 30.0


def test_it_is_withdrawn_with_whoever_asked(side: Side, monkeypatch: pytest.MonkeyPatch) -> None:
    closed = "not applied: the client has closed its connection"
    assert side.change("wall.stiffness=1", gone=True)["error"] == closed
    assert side.telemetry.words[Word.OFFERED] == 0, "the servo has not been started"
    side.start()
    answer = side.change("wall.stiffness=1", lambda: side.settle(-1), gone=True)
    assert answer["error"] == closed
    assert side.telemetry.words[Word.WITHDRAWN] == side.telemetry.words[Word.OFFERED] == 1
    monkeypatch.setattr(handover, "withdraw", lambda *_: side.settle(0))
    assert side.change("wall.stiffness=1", gone=True)["applied"], "it was too late"
    monkeypatch.undo()
    monkeypatch.setattr(module, "LOOP_S", 0.0)
    answer = side.change("wall.stiffness=2", gone=True)
    assert answer["error"] == closed, "the loop says nothing"


@pytest.mark.parametrize("started", [False, True])
def test_it_is_given_up_at_once_where_the_run_is_over(
    side: Side, started: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The loop may have died; the supervisor does not wait for long."""
    monkeypatch.setattr(module, "LOOP_S", 60.0)
    if started:
        side.start()
    side.over = True
    began_s = time.monotonic()
    assert side.change("wall.stiffness=1")["error"] == "not applied: the run is over"
    assert time.monotonic() - began_s < 60.0


@pytest.mark.parametrize("tripped", [False, True])
def test_a_change_of_a_run_that_an_axis_ends_is_told_why(arm: Side, tripped: bool) -> None:
    """The loop settles the change of an axis that has tripped a moment before it tells why."""
    acts = [lambda: arm.settle(-1), arm.end] if tripped else [arm.end]
    answer = arm.change("axes.arm.wall.stiffness=3", *acts)
    assert answer["error"] == "not applied: the run is over: trip:oscillation of elbow"
