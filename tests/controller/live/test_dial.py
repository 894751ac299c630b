"""Clients of a running wall, honest and hostile; they harm nothing but their own request."""

import contextlib
import json
import os
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, cast

import pytest

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.live import dial as module
from haptic_wall.controller.live.ask import NotAppliedError, ask
from haptic_wall.controller.live.change_desk import ChangeDesk
from haptic_wall.controller.live.dial import serve
from haptic_wall.controller.live.run_socket import (
    MODULE,
    MOST_BYTES,
    AliveRun,
    alive,
    chosen,
    connected,
    listening,
    socket_of,
)


class ScriptedDesk:
    """Answers at once; ``a=1`` waits until its client has gone, ``x`` is refused."""

    def __init__(self) -> None:
        self.asked: list[list[str]] = []
        self.withdrawn = False
        self.obstacles: list[str] = []
        """Of a change before it is made"""

    def change(
        self,
        sets: list[str],
        wait_s: float,
        tell_wait: Callable[[str], None],
        gone: Callable[[], bool],
    ) -> dict[str, Any]:
        assert wait_s >= 0.0
        self.asked.append(sets)
        if sets == ["x"]:
            return {"error": "refused: x: y", "field": "x", "advice": "wanted y", "exit_status": 2}
        while sets == ["a=1"] and not self.withdrawn:
            self.withdrawn = gone()
            time.sleep(1e-3)
        for each in self.obstacles:
            tell_wait(each)
        return {"applied": True, "changed": {}, "waited_s": 0.0}


class Served:
    """A dial in a thread."""

    def __init__(self, folder: Path) -> None:
        self.run = AliveRun(socket_of(folder / "run.hwlog"), os.getpid())
        self.desk = ScriptedDesk()
        self.told: list[str] = []
        self.over = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._listener = listening(self.run.socket)
        self._thread.start()

    def _serve(self) -> None:
        while not self.over.is_set():
            serve(self._listener, lambda: cast("ChangeDesk", self.desk), self.over.is_set)

    def asks(self, *sets: str) -> dict[str, Any]:
        return ask(self.run, sets, 1.0, self.told.append)

    def close(self) -> None:
        self.over.set()
        self._thread.join()
        self._listener.close()


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    monkeypatch.setattr(module, "IDLE_S", 0.01)
    made = Served(tmp_path)
    yield made
    made.close()


def sent(served: Served, content: bytes) -> dict[str, Any]:
    """Send anything; return the answer."""
    with connected(served.run.socket) as connection:
        connection.settimeout(20.0)
        connection.sendall(content)
        answer: dict[str, Any] = json.loads(connection.recv(MOST_BYTES))
        return answer


def test_a_request_is_answered(served: Served) -> None:
    answer = served.asks("wall.stiffness=4", "delay.steps=1")
    assert answer == {"applied": True, "changed": {}, "waited_s": 0.0}
    assert served.desk.asked == [["wall.stiffness=4", "delay.steps=1"]]


def test_what_is_refused_is_an_error_with_its_status(served: Served) -> None:
    with pytest.raises(NotAppliedError, match=r"^refused: x: y$") as caught:
        served.asks("x")
    assert caught.value.exit_status == 2
    problem = caught.value.problem
    assert (problem.field, problem.remedy) == ("x", "wanted y"), "as --json names them"


def test_a_client_is_told_why_it_waits_where_that_is_known(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    jump = "the torque would jump by {}e-3 N·m"
    served.desk.obstacles = ["", *map(jump.format, range(9, 4, -1))]
    served.asks("wall.stiffness=4")
    assert served.told == [], "it has not waited for long"
    monkeypatch.setattr(module, "TOLD_S", -1.0)
    served.asks("wall.stiffness=4")
    assert served.told == [f"waits: {jump.format(9)}"]


def test_only_the_owner_may_connect(served: Served) -> None:
    mode = served.run.socket.stat().st_mode
    assert stat.S_ISSOCK(mode) and stat.S_IMODE(mode) == 0o600


@pytest.mark.parametrize(
    "content",
    [
        b"\n",
        b'{"set": [4]}\n',
        b'{"set": ["a=1"], "wait_s": NaN}\n',
        b'{"set": ["a=1"], "wait_s": 1e9}\n',
        b'{"set": ' + b"[" * 30_000 + b"\n",
        json.dumps({"set": ["a=1"] * 101}).encode() + b"\n",
    ],
)
def test_garbage_is_answered_in_a_sentence(served: Served, content: bytes) -> None:
    told = sent(served, content)
    assert "wanted one line" in told["error"] and told["exit_status"] == 2
    assert served.desk.asked == []


def test_a_request_is_whole_within_its_limits(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    too_long = sent(served, b"a" * MOST_BYTES)
    assert too_long == {"error": "found a request of more than 65536 bytes", "exit_status": 2}
    monkeypatch.setattr(module, "READ_S", 0.1)
    too_slow = sent(served, b'{"set": ["wall.st')
    assert too_slow == {"error": "no whole request came within 0.1 s", "exit_status": 2}
    monkeypatch.setattr(module, "READ_S", 20.0)
    threading.Timer(0.1, served.over.set).start()
    over = sent(served, b'{"set": ["wall.st')
    assert over == {"error": "not applied: the run is over", "exit_status": 3}


def test_a_client_that_goes_takes_its_request_along(served: Served) -> None:
    with connected(served.run.socket) as gone:
        gone.send(b'{"set": ["a=1"]}\n')
    assert served.asks("b=1")["applied"]
    assert served.desk.withdrawn and served.desk.asked == [["a=1"], ["b=1"]]


def test_a_socket_that_a_killed_run_left_is_replaced_but_no_other_file(tmp_path: Path) -> None:
    path = tmp_path / "run.hwlog.sock"
    listening(path).close()
    with listening(path), pytest.raises(OSError, match="use"):
        listening(path)
    path.unlink()
    path.write_text("mine")
    with pytest.raises(OSError, match="use"):
        listening(path)
    assert path.read_text() == "mine"


_LISTENS = """
import socket, sys
listener = socket.socket(socket.AF_UNIX)
if sys.argv[-2] == "listen":
    listener.bind(sys.argv[-1])
    listener.listen()
print(flush=True)
sys.stdin.read()
"""


@contextlib.contextmanager
def processes(*words: Sequence[str | Path]) -> Iterator[list[subprocess.Popen[str]]]:
    """Processes with these last arguments; one with ``listen`` before the last listens there."""
    pipe = subprocess.PIPE
    with contextlib.ExitStack() as stack:
        made = []
        for each in words:
            arguments = [sys.executable, "-S", "-c", _LISTENS, *each]
            child = subprocess.Popen(arguments, stdin=pipe, stdout=pipe, text=True)
            made.append(stack.enter_context(child))
            assert child.stdout is not None
            child.stdout.readline()
        yield made
        for child in made:
            child.kill()


def test_a_run_is_the_process_that_listens_at_its_socket(tmp_path: Path) -> None:
    """Not one that has the words, nor a socket of a dead one."""
    log, other = tmp_path / "one" / "a.hwlog", tmp_path / "b.hwlog"
    log.parent.mkdir()
    for each in (log, other):
        listening(socket_of(each)).close()  # left behind
    socket_of(log).unlink()
    with processes(
        [MODULE],
        ["grep", MODULE, ""],
        ["grep", MODULE, socket_of(other)],
        ["edit", MODULE, tmp_path],
        ["dial", MODULE, socket_of(log), "listen", socket_of(log)],
        ["grep", MODULE, socket_of(log)],
    ) as made:
        found = [run for run in alive() if tmp_path in run.log.parents]
        assert found == [AliveRun(socket_of(log), made[4].pid)]
        assert chosen(log.parent, alive()) == chosen(log, alive()) == found[0]
        with pytest.raises(UserError, match="no wall is running in"):
            chosen(tmp_path, found)
        assert socket_of(log).exists() and not socket_of(other).exists()


def test_which_run_is_meant_is_asked_with_a_list(tmp_path: Path) -> None:
    runs = [AliveRun(socket_of(tmp_path / name), 1) for name in ("a.hwlog", "b.hwlog")]
    with pytest.raises(UserError, match=r"2 running walls: .*a\.hwlog, .*b\.hwlog"):
        chosen(None, runs)
    with pytest.raises(UserError, match=r"no wall is running in .*; name one of .*a\.hwlog"):
        chosen(tmp_path / "other", runs)
    with pytest.raises(UserError, match="no wall is running; start one"):
        chosen(None, [])
