"""Clients of a running wall, honest and hostile; they harm nothing but their own request."""

import contextlib
import json
import os
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, cast

import pytest

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.live import dial as module
from haptic_wall.controller.live.ask import NotAppliedError, ask
from haptic_wall.controller.live.change_desk import ChangeDesk
from haptic_wall.controller.live.dial import Dial
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
    """Answers after some looks; records what it was asked for."""

    def __init__(self, looks: int = 1) -> None:
        self.looks = looks
        self.asked: list[list[str]] = []
        self.withdrawn = 0
        self.unseen = -1
        """Looks that are left when the loop does not say why it waits"""
        self._left = 0

    def begin(self, sets: list[str], wait_s: float) -> dict[str, Any] | None:
        assert wait_s >= 0.0
        self.asked.append(sets)
        self._left = self.looks
        refused = {"error": "refused: x: y", "field": "x", "advice": "wanted y", "exit_status": 2}
        return refused if sets == ["x"] else None

    def look(self) -> dict[str, Any] | None:
        self._left -= 1
        return {"applied": True, "changed": {}, "waited_s": 0.0} if self._left <= 0 else None

    def obstacle(self) -> str:
        if self._left == self.unseen:
            return ""
        return f"the torque would jump by {self._left}e-3 N·m"

    def withdraw(self) -> None:
        self.withdrawn += 1
        self._left = 0

    def give_up(self) -> dict[str, Any]:
        self.withdrawn += 1
        return {"error": "the run is over", "exit_status": 3}


class Served:
    def __init__(self, folder: Path, desk: ScriptedDesk) -> None:
        self.run = AliveRun(socket_of(folder / "run.hwlog"), os.getpid())
        self.desk = desk
        self.dial = Dial(listening(self.run.socket), lambda: cast("ChangeDesk", desk))

    def until(self, done: Any, seconds: float = 20.0) -> None:
        end = time.monotonic() + seconds
        while not done():
            assert time.monotonic() < end
            self.dial.serve(0.01)


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    monkeypatch.setattr(module, "READ_S", 0.2)
    made = Served(tmp_path, ScriptedDesk())
    yield made
    made.dial.close()


class Client(threading.Thread):
    """Asks in a thread of its own."""

    def __init__(self, run: AliveRun, *sets: str) -> None:
        super().__init__(daemon=True)
        self.run_, self.sets = run, sets
        self.answer: Any = None
        self.told: list[str] = []
        self.start()

    def run(self) -> None:
        try:
            self.answer = ask(self.run_, self.sets, 1.0, self.told.append)
        except Exception as error:  # noqa: BLE001 - for the test to look at
            self.answer = error


def sent(served: Served, content: bytes) -> dict[str, Any]:
    """Send anything; return the answer."""
    with connected(served.run.socket) as connection:
        connection.setblocking(False)
        rest = memoryview(content)
        found = b""
        end = time.monotonic() + 20.0
        while b"\n" not in found:
            assert time.monotonic() < end
            with contextlib.suppress(OSError):
                rest = rest[connection.send(rest) :]
            served.dial.serve(0.01)
            with contextlib.suppress(BlockingIOError):
                found += connection.recv(MOST_BYTES)
        answer: dict[str, Any] = json.loads(found)
        return answer


def test_what_is_refused_is_an_error_with_its_status(served: Served) -> None:
    client = Client(served.run, "x")
    served.until(lambda: client.answer)
    assert isinstance(client.answer, NotAppliedError)
    assert (str(client.answer), client.answer.exit_status) == ("refused: x: y", 2)
    problem = client.answer.problem
    assert (problem.field, problem.remedy) == ("x", "wanted y"), "as --json names them"


def test_a_client_is_told_why_it_waits_where_that_is_known(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "TOLD_S", 0.0)
    served.desk.looks, served.desk.unseen = 10, 8
    client = Client(served.run, "wall.stiffness=4")
    served.until(lambda: client.answer)
    assert client.told == ["waits: the torque would jump by 9e-3 N·m"]


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


def test_a_client_that_goes_takes_its_request_along(served: Served) -> None:
    served.desk.looks = 1000
    with connected(served.run.socket) as gone:
        gone.send(b'{"set": ["a=1"]}\n')
        served.until(lambda: served.desk.asked)
    served.until(lambda: served.desk.withdrawn)
    client = Client(served.run, "x")
    served.until(lambda: client.answer)
    assert served.desk.asked == [["a=1"], ["x"]]


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
