"""A wall in processes of its own, changed through its socket; hostile clients do it no harm."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from haptic_wall.controller.cli.started import RunError, RunningWall, run
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.live.ask import NotAppliedError
from haptic_wall.controller.live.run_socket import connected, socket_of
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.runtime.telemetry import FLAG_CHANGED
from tests.support.program import PROGRAM, python, wait_for

pytestmark = pytest.mark.realtime


def attacked(wall: RunningWall) -> None:
    """Send garbage, too much, and nothing, all at once."""

    def attack(content: bytes, times: int) -> None:
        with contextlib.suppress(OSError), connected(socket_of(wall.log)) as connection:
            connection.settimeout(1.0)
            for _ in range(times):
                connection.sendall(content)

    contents = [(b"\xff\x00\n", 1), (b"a" * 2**20, 100), (b'{"set": ["wall.st', 1), (b"", 0)]
    threads = [
        threading.Thread(target=attack, args=contents[number % len(contents)])
        for number in range(50)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def asked(wall: RunningWall, *words: str) -> tuple[int, dict[str, object]]:
    """Call the command."""
    done = python(*PROGRAM[1:], "set", "--json", *words, "--run", wall.log)
    return done.returncode, json.loads(done.stdout)


def test_a_wall_is_changed_from_outside_and_its_clients_harm_nothing(tmp_path: Path) -> None:
    log = tmp_path / "run.hwlog"
    sets = ("servo.hand=push", "wall.stiffness=8", "loop.rate_hz=100", "realtime.profile=off")
    with run("simulated", sets, log=log) as wall:
        assert abs(wall.positions(most_age_s=5.0)[""]) < 3.2
        told = wall.set({"wall.stiffness": 4.0}, wait_s=60.0)
        assert told["applied"] and told["guard"]["requested"]["stiffness"] == 4.0
        attacked(wall)
        status, answer = asked(wall, "wall.law=detents", "wall.count=12", "--wait=60")
        assert (status, answer.get("applied")) == (0, True)
        with pytest.raises(NotAppliedError, match=r"loop\.rate_hz: found a setting that a running"):
            wall.set({"loop.rate_hz": 500})
        status, answer = asked(wall, "wall.law=spring", "wall.position=900", "--wait=0")
        if status == 0:
            assert isinstance(guard := answer["guard"], dict)
            assert guard["commanded"]["stiffness"] == 0.0
            pytest.skip("so late a loop that the guard commands nothing: any change is harmless")
        assert status == 3 and str(answer["error"]).startswith("not applied: ")
        assert wall.positions(most_age_s=5.0).keys() == {""}, "hostile clients took nothing away"
        with pytest.raises(RunError, match="is younger than 0 s: it hangs"):
            wall.positions(most_age_s=0.0)
        report = wall.report()
        with pytest.raises(RunError, match="has ended: interrupted"):
            wall.positions()
    with pytest.raises(RunError, match="has ended: interrupted"):
        wall.positions()  # by another thread that follows them, after the block
    assert report["stop_reason"] == "interrupted" and report["torque_off"]
    outcomes = [each["outcome"] for each in report["changes"]]
    assert outcomes == ["applied", "applied", "refused", "not applied"]
    read = LogReader.open(log)
    assert list(read.changes) == report["changes"], "the log tells them while the run goes on"
    rows = read.rows()
    changes = [each["row"] for each in report["changes"] if each["row"] is not None]
    assert rows["seq"][(rows["flags"] & FLAG_CHANGED) > 0].tolist() == changes
    assert not socket_of(log).exists()


def test_a_wall_that_cannot_start_says_why() -> None:
    for sets, duration_s, said in (
        (["wall.stiffness=-1"], None, r"wall\.stiffness"),
        (["loop.clock=simulated"], None, "duration_s: found none, .* simulated clock"),
        ([], -1.0, "duration_s: found -1, wanted a time above 0 s"),
    ):
        with pytest.raises(UserError, match=said), run("simulated", sets, duration_s=duration_s):
            pass
    with (
        pytest.raises(RunError, match=r"Port /dev/none does not exist") as caught,
        run("xm430-w350", {"servo.port": "/dev/none"}),
    ):
        pass
    assert caught.value.exit_status == 4


@pytest.mark.whole
def test_a_wall_outlives_the_thread_that_started_it() -> None:
    with contextlib.ExitStack() as scope, ThreadPoolExecutor(1) as starter:
        walls = starter.submit(scope.enter_context, run("simulated", ["realtime.profile=off"]))
        wall = walls.result()
        starter.shutdown()
        time.sleep(0.5)
        assert wall.running()


def test_a_wall_ends_with_its_starter_whose_own_children_live_on() -> None:
    code = (
        "from haptic_wall.controller.cli.started import run\n"
        "import os, time\n"
        "with run('simulated', ['realtime.profile=off']) as wall:\n"
        "    if not (child := os.fork()):\n"
        "        os.close(1)\n"
        "        time.sleep(60)\n"
        "        os._exit(0)\n"
        "    print(wall._process.pid, child, flush=True)\n"
        "    os._exit(1)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=False
    )
    wall, child = map(int, done.stdout.split())
    process = Path(f"/proc/{wall}")
    end = "the end of the wall"
    wait_for(lambda: not process.exists() or not (process / "cmdline").read_bytes(), end, 40.0)
    os.kill(child, signal.SIGKILL)
