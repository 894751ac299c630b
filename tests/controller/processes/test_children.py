"""Child processes are this program's, wherever the user stands; who waits for one may give up."""

import json
import os
import signal
import subprocess
import sys
from typing import Any

import pytest

from haptic_wall.controller.emulated_bus.bus import PROGRAM
from haptic_wall.controller.processes import emulator
from haptic_wall.controller.processes.children import Child, first_line
from haptic_wall.controller.system.signals import on_signals
from haptic_wall.hw.errors import ServoError
from tests.cases import sampled
from tests.support.program import python


def test_a_ctrl_c_while_a_child_is_started_reaches_its_parent_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The child is in the terminal's group for a moment yet, and would die of it."""
    heard = []
    started = subprocess.Popen

    def interrupted(*arguments: Any, **options: Any) -> subprocess.Popen[bytes]:
        os.kill(os.getpid(), signal.SIGINT)
        process = started(*arguments, **options)
        os.kill(process.pid, signal.SIGINT)
        return process

    monkeypatch.setattr(subprocess, "Popen", interrupted)
    with on_signals(lambda *_: heard.append("once"), (signal.SIGINT,)):
        child = Child("main", ["haptic_wall.controller.cli.main", "--version"], None)
    try:
        assert "haptic-wall" in (first_line(child, 30.0) or "")
    finally:
        child.dismiss(2.0)
    assert heard == ["once"]


@pytest.mark.parametrize("module", ["processes.loop_process", "processes.recorder", "live.door"])
@pytest.mark.parametrize("told", sampled(['{"par', ""], 2))
def test_a_child_whose_parent_was_interrupted_before_it_gave_orders_ends(
    module: str, told: str
) -> None:
    done = python("-m", f"haptic_wall.controller.{module}", input=told)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_bus_that_is_stopped_in_its_start_is_named_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def stop(child: Child, *more: Any) -> str | None:
        child.send(signal.SIGSTOP)
        os.waitid(os.P_PID, child.pid, os.WSTOPPED)
        return first_line(child, *more)

    monkeypatch.setattr(emulator, "first_line", stop)
    with (
        pytest.raises(ServoError, match="did not start: it was stopped by a signal"),
        emulator.emulated_bus([PROGRAM, '{"servos": []}'], os.sched_getaffinity(0)),
    ):
        pass


def test_the_bus_of_a_run_that_was_killed_in_its_start_ends_by_itself() -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    plan = {"servos": ["XM430-W350:1"], "truth": {}, "baud": 4_000_000, "starter": dead.pid}
    subprocess.run([sys.executable, "-P", "-m", PROGRAM, json.dumps(plan)], timeout=60, check=True)
