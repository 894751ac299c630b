"""The supervisor's side of the door: it holds no end of a run up, and leaves nothing behind."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import pytest

from haptic_wall.controller.live.place import Live
from haptic_wall.controller.live.run_socket import listening, socket_of
from haptic_wall.controller.processes import door_monitor
from haptic_wall.controller.processes.children import Child
from haptic_wall.controller.processes.door_monitor import Door
from haptic_wall.controller.processes.plan import Plan
from haptic_wall.controller.runtime.telemetry import Telemetry
from haptic_wall.controller.settings.load import load_config


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    """A run with a page that holds the dead man."""
    config = load_config("simulated", ()).config
    live = Live(os.open(os.devnull, os.O_RDONLY), "localhost", "http://localhost:1/", "token")
    plan = Plan(config, None, tmp_path / "a.hwlog", {"name": "a"}, None, live=live)
    return replace(plan, hold="page", changeable=True)


def opened(plan: Plan, told: list[str], monkeypatch: pytest.MonkeyPatch, code: str) -> Door:
    """A door whose process runs other code."""

    def played(name: str, *_: object) -> Child:
        return Child(name, ["timeit", "-n1", "-r1", code], None)

    monkeypatch.setattr(door_monitor, "Child", played)
    return Door(plan, Telemetry.create(), told.append, set(), 0)


def test_a_stopped_door_is_killed_after_its_time(
    plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(door_monitor, "END_S", 0.1)
    told: list[str] = []
    made = opened(plan, told, monkeypatch, "import time; time.sleep(60)")
    child = made._child
    assert child is not None
    os.kill(child.pid, signal.SIGSTOP)
    while child.doing() != "was stopped by a signal":
        time.sleep(0.001)
    made.look()
    assert told == []
    began_s = time.monotonic()
    for _ in range(300):  # nothing waits for one that does not read
        made.pass_on("x" * 1000)
    made.close("duration")
    assert 0.1 <= time.monotonic() - began_s < 2.0
    assert child.exit_text() == "was killed by SIGKILL"


@pytest.mark.parametrize("ends", ["look", "close"])
def test_a_door_that_died_leaves_no_socket_and_its_page_holds_no_more(
    plan: Plan, monkeypatch: pytest.MonkeyPatch, ends: str
) -> None:
    told: list[str] = []
    listening(socket_of(plan.log)).close()
    made = opened(plan, told, monkeypatch, "import os; os._exit(3)")
    assert made._child is not None
    made._child.wait(20.0)
    if ends == "look":
        made.look()
        gone = "the process for changes and page ended with 3"
        assert told[0] == f"{gone}; the run goes on without it"
        assert told[1] == made.trouble == f"--hold: {gone}; the wall stays off until the run ends"
    made.close()
    assert not socket_of(plan.log).exists()
