"""The page of the demo: two runs behind one address, and nobody changes them without the token."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from haptic_wall.controller.cli.demo_walls import SERVO, SERVOS
from haptic_wall.controller.live.lesson_process import Stage, serve_lesson
from haptic_wall.controller.live.place import Live, hand_over
from haptic_wall.controller.live.run_socket import listening
from haptic_wall.controller.runtime.telemetry import Row, Telemetry, Word
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.hand import SharedHand

TOKEN = "the-right-token"
BEGAN_NS = 5_000_000_000
LAG_S = 0.002


class FakeRun:
    """A run as the page sees it: rows, a hand, news, and the socket for changes."""

    def __init__(self, name: str, folder: Path) -> None:
        self.config = load_config("simulated", [*SERVO, *SERVOS[name]]).config
        self.telemetry = Telemetry.create()
        self.telemetry.words[Word.BEGAN_NS] = BEGAN_NS
        self.hand = SharedHand.create()
        self.socket = folder / f"{name}.sock"
        self.listener = listening(self.socket)
        self.listener.settimeout(10.0)
        row = Row(stiffness=2.5, delay_s=self.config.belief().delay.high)
        for k in range(50):
            row.deadline_ns, row.position = BEGAN_NS + 1_000_000 * k, 0.001 * k
            self.telemetry.write(row)

    def show(self, line: socket.socket) -> None:
        """Send it to the page, as its supervisor does."""
        self.news, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        shown: dict[str, Any] = {"name": "simulated", "config": self.config.model_dump_json()}
        shown |= {"run": str(self.socket), "dead_man": False}
        inherited = {"telemetry": self.telemetry.descriptor, "news": theirs.fileno()}
        hand_over(line.fileno(), shown, inherited | {"hand": self.hand.descriptor})
        theirs.close()

    def close(self) -> None:
        self.news.close()
        self.listener.close()
        self.telemetry.close()
        self.hand.close()


class Page:
    """The page's server in a thread, with two runs."""

    first: dict[str, list[str]]
    """The first change that each run was asked for"""

    def __init__(self, folder: Path) -> None:
        self._over = False
        listener = socket.create_server(("127.0.0.1", 0))
        self.place = f"127.0.0.1:{listener.getsockname()[1]}"
        live = Live(listener.detach(), "127.0.0.1", "", TOKEN)
        self.lines, self._theirs, stages = {}, {}, {}
        for name in SERVOS:
            pair = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            self.lines[name], self._theirs[name] = pair
            pair[1].setblocking(False)
            stages[name] = Stage(pair[1], live, lambda: self._over)
        self._thread = threading.Thread(target=lambda: asyncio.run(serve_lesson(stages, live)))
        self._thread.start()
        self.runs = {name: FakeRun(name, folder) for name in SERVOS}
        for name, run in self.runs.items():
            run.show(self.lines[name])

    def connect(self, servo: str = "free", token: str = TOKEN, **more: Any) -> ClientConnection:
        query = f"?servo={servo}" + (f"&token={token}" if token else "")
        found: ClientConnection = connect(f"ws://{self.place}/rows{query}", **more)
        return found

    def close(self) -> None:
        self._over = True
        self._thread.join(10.0)
        assert not self._thread.is_alive()
        for each in (*self.lines.values(), *self._theirs.values()):
            each.close()
        for run in self.runs.values():
            run.close()


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    made = Page(tmp_path_factory.mktemp("runs"))
    for servo in SERVOS:
        until(lambda servo=servo: greeted(made, servo))  # type: ignore[misc]
    made.first = {name: asked(run) for name, run in made.runs.items()}
    yield made
    made.close()


def greeted(page: Page, servo: str) -> bool:
    """Whether a servo's run is shown."""
    with page.connect(servo) as client:
        try:
            heard(client, "hello")
        except ConnectionClosed:
            return False
    return True


def heard(
    client: ClientConnection, kind: str, wanted: Callable[[dict[str, Any]], Any] = bool
) -> dict[str, Any]:
    """The next object of a kind that is as wanted."""
    end_s = time.monotonic() + 20.0
    while time.monotonic() < end_s:
        message = client.recv(timeout=10.0)
        if isinstance(message, str):
            found: dict[str, Any] = json.loads(message)
            if found["kind"] == kind and wanted(found):
                return found
    raise AssertionError(kind)


def until(condition: Callable[[], Any]) -> None:
    end_s = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.005)


def asked(run: FakeRun, answer: bytes = b'{"applied": true}') -> list[str]:
    """The change that the run is asked for next, and answers; otherwise it is made."""
    connection, _ = run.listener.accept()
    with connection:
        connection.settimeout(10.0)
        sets: list[str] = json.loads(connection.recv(65536))["set"]
        connection.sendall(answer + b"\n")
    return sets


def test_each_servo_begins_with_the_soft_wall_and_a_scene_changes_one_servo(page: Page) -> None:
    assert page.first["free"] == page.first["guarded"], "both get the same walls"
    with page.connect("free") as client:
        told = heard(client, "lesson", lambda each: each["scenes"])
        assert told["scene"] == "soft"
        assert told["facts"]["delay"] == pytest.approx(LAG_S), "the true one, not the believed"
        raises = page.runs["free"].telemetry.words[Word.RAISE]
        client.send('{"scene": "stiff"}')
        hand = page.runs["free"].hand
        until(lambda: hand.look(time.monotonic_ns()) is not None)
        assert hand.look(time.monotonic_ns()).target < 0.0  # type: ignore[union-attr]
        sets = asked(page.runs["free"])
        assert sets == [f"{path}={value}" for path, value in told["scenes"]["stiff"].items()]
        assert page.runs["free"].telemetry.words[Word.RAISE] == raises + 1
        heard(client, "lesson", lambda each: each["scene"] == "stiff")
        until(lambda: hand.look(time.monotonic_ns()) is None)
    with page.connect("guarded") as client:
        assert heard(client, "lesson")["scene"] == "soft"


def test_a_change_that_a_run_cannot_take_yet_is_asked_for_again(page: Page) -> None:
    run = page.runs["guarded"]
    with page.connect("guarded") as client:
        client.send('{"scene": "stiff"}')
        sets = asked(run, b'{"error": "not applied: not started", "exit_status": 3}')
        assert asked(run) == sets
        client.send('{"scene": "soft"}')
        asked(run, b'{"error": "refused: x", "exit_status": 2}')
        run.listener.settimeout(1.0)
        with pytest.raises(TimeoutError):
            run.listener.accept()
        run.listener.settimeout(10.0)


def test_a_readers_servo_is_computed(page: Page) -> None:
    own = {"inertia": 0.01, "damping": 0.01, "period": 1e-3, "delay": 2e-3, "virtual_damping": 0.05}
    with page.connect() as client:
        client.send(json.dumps({"own": own}))
        assert heard(client, "own")["exact"] > 1.0
        client.send(json.dumps({"own": own | {"inertia": "x"}}))
        assert "inertia" in heard(client, "own")["trouble"]


@pytest.mark.parametrize("servo", ["", "other", "../free"])
def test_an_address_without_a_servo_is_refused(page: Page, servo: str) -> None:
    with page.connect(servo) as client, pytest.raises(ConnectionClosed):
        client.recv(timeout=10.0)
    assert client.close_code == 1008


def test_a_hostile_client_changes_nothing(page: Page) -> None:
    run = page.runs["free"]
    before = run.telemetry.words[Word.RAISE]
    with page.connect(token="wrong") as client:
        with pytest.raises(ConnectionClosed):
            client.recv(timeout=10.0)
        assert client.close_code == 1008
    with pytest.raises(HTTPError) as found:
        urlopen(Request(f"http://{page.place}/rows", headers={"Origin": "http://evil.example"}))
    assert found.value.code == 403
    found.value.close()
    with page.connect(token="") as client:
        for message in ('{"scene": "stiff"}', '{"drop": true}', '{"own": {}}', '{"hand": null}'):
            client.send(message)
            heard(client, "refused")
    with page.connect() as client:
        nonsense = ("{", "[" * 3000, '{"scene": 7}', '{"scene": "x"}', '{"drop": 1}', '{"own": 1}')
        for message in nonsense:
            client.send(message)
            heard(client, "refused")
        with pytest.raises((ConnectionClosed, OSError)):
            client.send("x" * 100_000)
            while True:
                client.recv(timeout=10.0)
    assert run.telemetry.words[Word.RAISE] == before
    run.listener.settimeout(0.2)
    with pytest.raises(TimeoutError):
        run.listener.accept()
    run.listener.settimeout(10.0)


def test_a_client_that_goes_in_mid_drag_lets_go(page: Page) -> None:
    run = page.runs["guarded"]
    with page.connect("guarded") as client:
        heard(client, "lesson")
        until(lambda: run.hand.look(time.monotonic_ns()) is None)
        client.send('{"hand": {"position": 0.1, "stiffness": 4}}')
        until(lambda: run.hand.look(time.monotonic_ns()) is not None)
    until(lambda: run.hand.look(time.monotonic_ns()) is None)


def test_a_weight_that_was_thrown_away_is_brought_back(page: Page) -> None:
    run = page.runs["guarded"]
    until(lambda: run.hand.look(time.monotonic_ns()) is None)
    row = Row(stiffness=2.5, position=-4.7)
    row.deadline_ns = BEGAN_NS + 1_000_000_000
    run.telemetry.write(row)
    until(lambda: run.hand.look(time.monotonic_ns()) is not None)
    row.position = 0.0
    run.telemetry.write(row)
    until(lambda: run.hand.look(time.monotonic_ns()) is None)


def test_a_run_that_is_started_anew_is_shown_again(page: Page) -> None:
    run = page.runs["guarded"]
    with page.connect("guarded") as client:
        heard(client, "hello")
        run.news.close()
        with pytest.raises((ConnectionClosed, OSError)):
            while True:
                client.recv(timeout=10.0)
    run.show(page.lines["guarded"])
    until(lambda: greeted(page, "guarded"))


def test_the_end_is_told_to_who_is_there(tmp_path: Path) -> None:
    page = Page(tmp_path)
    for servo in SERVOS:
        until(lambda servo=servo: greeted(page, servo))  # type: ignore[misc]
    with page.connect("free") as free, page.connect("guarded", token="") as guarded:
        for client in (free, guarded):
            heard(client, "hello")
        page.close()
        for client in (free, guarded):
            assert heard(client, "over")
