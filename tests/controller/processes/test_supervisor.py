"""However a loop ends, its torque is switched off after it can speak no more, and it is said how.

The children are played; the whole tree of real processes is in tests/test_runs.py.
"""

import json
import os
import signal
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NoReturn

import pytest

from haptic_wall.controller.processes import emulator, recorder_monitor, supervisor, torque_cut
from haptic_wall.controller.processes.plan import Ended, Plan
from haptic_wall.controller.processes.run_report import exit_status, explanation, run_report
from haptic_wall.controller.processes.supervisor import Supervisor
from haptic_wall.controller.report.run_text import report_text
from haptic_wall.controller.runtime.telemetry import LoopState, Telemetry, Word
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.elastic import PLACE, SENT
from haptic_wall.hw.errors import Problem, ServoError
from tests.typed import not_none

RESULT = {
    "stop_reason": "trip:overspeed",
    "message": "",
    "ticks": 7,
    "missed": 0,
    "elapsed_s": 0.007,
    "torque_off": True,
}


class Child:
    """A process that does as it is told by ``acts``; the recorder has nothing to do."""

    def __init__(
        self,
        name: str,
        _arguments: Sequence[str],
        _orders: Mapping[str, Any] | None,
        _descriptors: Sequence[int] = (),
        _cores: set[int] | None = None,
    ) -> None:
        self.name = name
        self.pidfd, self._end = os.pipe()
        self.output, self._voice = os.pipe()
        os.set_blocking(self.output, False)
        self.code: int | None = None
        self.sent: list[Any] = []
        CHILDREN[name] = self

    def say(self, event: str, **content: Any) -> None:
        os.write(self._voice, (json.dumps({"event": event, **content}) + "\n").encode())

    def end(self, code: int) -> None:
        if self.code is None:
            self.code = code
            os.close(self._end)

    def said(self) -> list[Any]:
        try:
            return [json.loads(line) for line in os.read(self.output, 65536).splitlines()]
        except BlockingIOError:
            return []

    lines = said

    def ended(self) -> bool:
        if self.name == "recorder":
            self.end(0)
        return self.code is not None

    def well(self) -> bool:
        return self.code == 0

    def doing(self) -> str:
        return "was busy"

    def halted(self) -> bool:
        return False

    def exit_text(self) -> str:
        return f"ended with {self.code}"

    def wait(self, _timeout_s: float) -> bool:
        return self.ended()

    def send(self, number: signal.Signals) -> None:
        self.sent.append(number)
        if number == signal.SIGKILL:
            self.end(-9)

    def dismiss(self, _timeout_s: float) -> None:
        self.end(-9)
        for descriptor in (self.pidfd, self.output, self._voice):
            os.close(descriptor)


CHILDREN: dict[str, "Child"] = {}


class Stage:
    """A supervisor with played children on a servo whose torque it can switch off, or not."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
        config = load_config("xm430-w350", ["servo.port=/dev/null", "model.delay=0"]).config
        self.telemetry = Telemetry.create()
        self.words = self.telemetry.words
        self.plan = Plan(config, None, folder / "run.hwlog", {}, None)
        self.told: list[str] = []
        self.cuts: list[tuple[bool, int]] = []
        self.confirmed = True
        self.loop_acts: Callable[[Child], object] = lambda loop: loop
        CHILDREN.clear()
        for module in (supervisor, emulator, recorder_monitor):
            monkeypatch.setattr(module, "Child", self.child)
        monkeypatch.setattr(torque_cut, "cut_torque", self.cut)
        monkeypatch.setattr(
            supervisor, "open_port", lambda _settings: os.open("/dev/null", os.O_RDWR)
        )

    def child(self, *arguments: Any) -> Child:
        child = Child(*arguments)
        if child.name == "loop":
            self.words[Word.STATE] = LoopState.RUNNING
            self.words[Word.HEARTBEAT_NS] = time.monotonic_ns()
            self.loop_acts(child)
        return child

    def cut(self, *_: object) -> bool:
        loop = CHILDREN["loop"]
        self.cuts.append((loop.ended(), self.words[Word.CUT]))
        return self.confirmed

    def run(self) -> tuple[Ended, dict[str, Any]]:
        ended = Supervisor(self.plan, self.telemetry, self.told.append).run()
        return ended, run_report(self.plan.config, ended, None, None)


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Stage:
    return Stage(monkeypatch, tmp_path)


SILENT_AND_MARKED = [(True, 1)]
"""When the torque was cut the loop was dead, and the memory said that the bus is not its own"""


def test_torque_that_cannot_be_read_back_as_off_is_never_called_off(stage: Stage) -> None:
    stage.confirmed = False
    stage.loop_acts = lambda loop: loop.end(1)
    ended, report = stage.run()
    assert report["torque_off"] is False
    assert "switch the servo's power off" in not_none(explanation(ended, stage.plan.config.servo))
    assert "switched the torque off" not in not_none(explanation(ended, stage.plan.config.servo))


@pytest.mark.parametrize("confirmed", [True, False])
def test_what_the_loop_could_not_read_back_the_supervisor_tries_again(
    stage: Stage, confirmed: bool
) -> None:
    def trip(loop: Child) -> None:
        loop.say("ended", result={**RESULT, "torque_off": False})
        loop.end(0)

    stage.loop_acts, stage.confirmed = trip, confirmed
    ended, report = stage.run()
    assert ended.stop_reason == "trip:overspeed"
    assert report["torque_off"] is confirmed
    assert len(stage.cuts) == 1


@pytest.mark.parametrize("state", [LoopState.STARTING, LoopState.RUNNING, LoopState.STOPPING])
def test_a_stop_before_the_first_tick_is_no_trip_however_slow_the_machine(
    stage: Stage, state: LoopState, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("haptic_wall.controller.processes.loop_watch.END_S", 0.1)
    stage.words[Word.STOP] = 1

    def start(_loop: Child) -> None:
        stage.words[Word.HEARTBEAT_NS] = time.monotonic_ns() + 10**10
        stage.words[Word.STATE] = state

    stage.loop_acts = start
    ended, report = stage.run()
    assert ended.stop_reason == "interrupted"
    assert stage.cuts == SILENT_AND_MARKED
    assert report["torque_off"] is True
    assert "being asked to" in "".join(ended.warnings)


def test_a_stop_while_the_loop_still_computes_ends_the_run_at_once(stage: Stage) -> None:
    """Its imports and computations take many seconds on a busy machine."""

    def stop(_loop: Child) -> None:
        stage.words[Word.STATE], stage.words[Word.STOP] = LoopState.PREPARING, 1

    stage.loop_acts = stop
    began = time.monotonic()
    ended, report = stage.run()
    assert time.monotonic() - began < 1.0
    assert exit_status(ended.stop_reason) == 130
    assert stage.cuts == SILENT_AND_MARKED
    assert report["torque_off"] is True and ended.warnings == []


def test_a_defect_of_the_supervisor_leaves_no_torque_on(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> NoReturn:
        raise ZeroDivisionError("boom")

    monkeypatch.setattr(Supervisor, "_hear", broken)
    stage.loop_acts = lambda loop: loop.say("tell", text="something to hear")
    with pytest.raises(ZeroDivisionError):
        stage.run()
    assert stage.words[Word.STOP] == 1, "it was asked first"
    assert stage.cuts == SILENT_AND_MARKED


GONE = Problem("The servo answers no more", advice="check the cable.", mark=": ")


def refused(stage: Stage, state: LoopState) -> str:
    """What a person is told when the loop refuses the run in that state."""

    def refuse(loop: Child) -> None:
        stage.words[Word.STATE] = state
        loop.say("refused", problem=asdict(GONE))
        loop.end(0)

    stage.loop_acts = refuse
    with pytest.raises(ServoError) as raised:
        stage.run()
    return str(raised.value)


@pytest.mark.parametrize("state", [LoopState.TORQUE_UNKNOWN, LoopState.STOPPING, LoopState.RUNNING])
@pytest.mark.parametrize(
    ("confirmed", "words"),
    [(True, "the supervisor switched the torque off and read it back"), (False, "power off")],
)
def test_a_refused_start_whose_torque_is_not_known_to_be_off_is_cut(
    stage: Stage, state: LoopState, confirmed: bool, words: str
) -> None:
    stage.confirmed = confirmed
    message = refused(stage, state)
    assert [dead for dead, _ in stage.cuts] == [True]
    assert message.startswith("The servo answers no more: check the cable.")
    assert words in message


@pytest.mark.parametrize("result", [None, {**RESULT, "stop_reason": "trip:loss_rate"}])
@pytest.mark.parametrize("how", ["dead", "stopped", "hung"])
def test_a_bus_that_dies_or_hangs_is_named_and_torque_is_spoken_of_once(
    stage: Stage, monkeypatch: pytest.MonkeyPatch, how: str, result: dict[str, Any] | None
) -> None:
    safety = ["safety.heartbeat_s=0.1"]
    stage.plan = replace(stage.plan, config=load_config("emulated-ideal", safety).config)
    monkeypatch.setattr(emulator, "first_line", lambda *_: "/dev/null")
    monkeypatch.setattr(supervisor, "PATIENCE_S", 0.1)
    stage.words[Word.HEAD], stage.confirmed = 1, False

    def act(loop: Child) -> None:
        bus = CHILDREN["emulator"]
        if how == "dead":
            bus.end(-9)
        stage.words[Word.COUPLED], stage.words[PLACE + SENT] = int(how == "hung"), 12
        monkeypatch.setattr(
            bus, "doing", lambda: "was stopped by a signal" if how == "stopped" else "was busy"
        )
        if result is not None:
            loop.say("ended", result={**result, "torque_off": False})
            loop.end(0)

    stage.loop_acts = act
    ended, report = stage.run()
    assert ended.stop_reason == ("trip:servo_lost" if result is None else "trip:loss_rate")
    assert report["explanation"].startswith("the emulated bus ")
    assert {"dead": "ended with -9", "stopped": "by a signal", "hung": "busy"}[how] in ended.cause
    text = " ".join(report_text(report).split()).lower()
    assert text.count("could not be read back") == text.count("switch its power off") == 1
    assert "the loop's process" not in text


def test_a_loop_waits_no_longer_for_a_bus_that_is_halted(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage.plan = replace(stage.plan, config=load_config("emulated-ideal", []).config)
    monkeypatch.setattr(emulator, "first_line", lambda *_: "/dev/null")
    monkeypatch.setattr(supervisor, "LOOK_S", 0.01)
    coupled: list[int] = []

    def act(loop: Child) -> None:
        monkeypatch.setattr(CHILDREN["emulator"], "halted", lambda: True)
        stage.words[Word.COUPLED] = 1

        def end() -> None:
            coupled.append(stage.words[Word.COUPLED])
            loop.end(1)

        threading.Timer(0.3, end).start()

    stage.loop_acts = act
    stage.run()
    assert coupled == [0]


def test_a_loop_that_is_stopped_while_it_starts_is_not_waited_for(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervisor, "LOOK_S", 0.01)

    def act(loop: Child) -> None:
        stage.words[Word.STATE] = LoopState.STARTING
        monkeypatch.setattr(loop, "halted", lambda: True)
        monkeypatch.setattr(loop, "doing", lambda: "was stopped by a signal")

    stage.loop_acts = act
    began_s = time.monotonic()
    ended, _ = stage.run()
    assert ended.stop_reason == "trip:loop_hung"
    assert ended.cause.startswith("the loop's process did not start (it was stopped by a signal)")
    assert time.monotonic() - began_s < 5.0


def test_a_stop_while_the_emulated_bus_hangs_in_its_start_ends_the_run_at_once(
    stage: Stage,
) -> None:
    """Ctrl-C; a bus that is stuck does not even heed a polite end."""
    stage.plan = replace(stage.plan, config=load_config("emulated-ideal", []).config)
    threading.Timer(0.1, stage.words.__setitem__, (Word.STOP, 1)).start()
    began = time.monotonic()
    ended, report = stage.run()
    assert time.monotonic() - began < 1.0
    assert ended.stop_reason == "interrupted"
    assert exit_status(ended.stop_reason) == 130
    assert signal.SIGKILL in CHILDREN["emulator"].sent
    assert "loop" not in CHILDREN and stage.cuts == []
    assert report["torque_off"] is True and report["ticks"] == 0
