"""However a session fails, it is known whether torque is off; a run that was is reported."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NoReturn

import pytest

from haptic_wall.controller.runtime import session_result, session_start
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.runtime.session_result import Result
from haptic_wall.controller.runtime.telemetry import LoopState, Telemetry, Word
from haptic_wall.hw.dynamixel.group import DynamixelGroup
from haptic_wall.hw.emulated.memory_line import MemoryLine
from haptic_wall.hw.errors import (
    ServoLostError,
    ServoMissingError,
    StrangeServoError,
)
from haptic_wall.hw.open import open_bus
from tests.support.simulated_run import session


class Scene:
    """A session on a bus in memory whose host can be made deaf."""

    def __init__(self) -> None:
        self.telemetry = Telemetry.create()
        self.words = self.telemetry.words
        self.sent = 0
        self.opener: Callable[..., DynamixelGroup] = self.open

    def open(self, *arguments: Any) -> DynamixelGroup:
        servo = open_bus(*arguments)
        assert isinstance(servo, DynamixelGroup)
        line = servo.line
        assert isinstance(line, MemoryLine)
        self.line = line
        self._read, self._write = line.read, line.write
        line.write = self.write  # type: ignore[method-assign]
        (self.truth,) = line.bus.servos
        return servo

    def write(self, data: bytes) -> None:
        self.sent += 1
        self._write(data)

    def go_deaf(self) -> None:
        """No reply comes through any more."""
        self.line.read = lambda: self._read()[:0]  # type: ignore[method-assign]

    def run(self) -> Result:
        return session(
            "emulated-ideal",
            "servo.schedule=pipelined",
            duration=0.1,
            telemetry=self.telemetry,
            opener=self.opener,
        )[0]


@pytest.fixture
def scene() -> Scene:
    return Scene()


def test_the_servos_supply_and_temperature_are_in_the_shared_memory(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("haptic_wall.controller.runtime.loop.BLOCK", 50)
    monkeypatch.setattr("haptic_wall.hw.dynamixel.health.EVERY_NS", 10_000_000)
    scene.run()
    words = scene.telemetry.words
    assert words[Word.SUPPLY_MV] == 12_000
    assert 20_000 <= words[Word.TEMPERATURE_MC] <= 40_000


@pytest.mark.parametrize("deaf", [True, False])
def test_an_error_between_the_start_and_the_run_ends_with_torque_off_or_says_so(
    scene: Scene, deaf: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The pipelined schedule sends its first request while the tick is made."""

    def lost(_: object) -> NoReturn:
        if deaf:
            scene.go_deaf()
        raise ServoLostError("The serial port has sent nothing.")

    monkeypatch.setattr(DynamixelGroup, "request", lost)
    with pytest.raises(ServoLostError):
        scene.run()
    assert scene.words[Word.STATE] == (LoopState.TORQUE_UNKNOWN if deaf else LoopState.TORQUE_OFF)
    assert scene.truth.memory["torque_enable"] == 0, "what was sent was heard"
    assert scene.words[Word.HEARTBEAT_NS] > 0, "or its end would be called overdue at once"


@pytest.mark.parametrize("error", [ServoLostError("Gone."), KeyboardInterrupt()])
def test_a_start_that_fails_under_torque_does_not_call_it_off_unconfirmed(
    scene: Scene, error: BaseException, monkeypatch: pytest.MonkeyPatch
) -> None:
    def push(*_: object, **__: object) -> NoReturn:
        assert scene.truth.memory["torque_enable"] == 1
        scene.go_deaf()
        raise error

    monkeypatch.setattr("haptic_wall.hw.dynamixel.startup.prove_the_sign", push)
    with pytest.raises(type(error)):
        scene.run()
    assert scene.words[Word.STATE] == LoopState.TORQUE_UNKNOWN


def test_what_never_answered_was_never_driven(scene: Scene) -> None:
    opener = scene.opener

    def unplugged(*arguments: Any) -> DynamixelGroup:
        servo = opener(*arguments)
        scene.go_deaf()
        return servo

    scene.opener = unplugged
    with pytest.raises(ServoMissingError):
        scene.run()
    assert scene.words[Word.STATE] == LoopState.STARTING, "nothing to be cut"


def test_what_is_no_known_servo_is_neither_stopped_nor_left_to_be_cut(scene: Scene) -> None:
    opener = scene.opener

    def exchanged(*arguments: Any) -> DynamixelGroup:
        servo = opener(*arguments)
        scene.truth.model = replace(scene.truth.model, number=2020)
        return servo

    scene.opener = exchanged
    with pytest.raises(StrangeServoError, match="nothing was written to it"):
        scene.run()
    assert scene.words[Word.STATE] == LoopState.STARTING, "the supervisor writes nothing either"


def test_an_error_before_the_start_touches_no_servo(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> NoReturn:
        raise ZeroDivisionError("boom")

    monkeypatch.setattr(session_start, "gain_table", broken)
    with pytest.raises(ZeroDivisionError):
        scene.run()
    assert scene.words[Word.STATE] == LoopState.PREPARING
    assert scene.sent == 0


def broken_report(*_: object, **__: object) -> NoReturn:
    raise ZeroDivisionError("boom")


@pytest.mark.parametrize("part", ["decision_report", "oscillation_report", "delay_report"])
def test_a_defect_after_the_run_costs_no_more_than_what_it_was_to_tell(
    scene: Scene, part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session_result, part, broken_report)
    result = scene.run()
    assert result.stop_reason == Trip.INTERNAL_ERROR
    assert "ZeroDivisionError: boom (in broken_report, test_session_ends.py line" in result.message
    assert result.torque_off
    assert (result.ticks, result.missed) == (100, 0)
    assert result.guard is None
    assert scene.words[Word.STATE] == LoopState.TORQUE_OFF
