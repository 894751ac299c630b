"""The page's server: what it serves, whom it refuses, and that no client harms another."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from haptic_wall.controller import live as room
from haptic_wall.controller.live.dead_man import DeadMan
from haptic_wall.controller.live.frames import CHANNELS
from haptic_wall.controller.live.run_socket import listening
from haptic_wall.controller.live.server import LiveServer
from haptic_wall.controller.live.source import RunningSource
from haptic_wall.controller.live.view import View
from haptic_wall.controller.runtime.telemetry import Telemetry, Word
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.hand import SharedHand
from tests.controller.live import strangers
from tests.support.rows import row

PAGE = Path(str(room.__file__)).parent / "page"
TOKEN = "the-right-token"
BEGAN_NS = 5_000_000_000
CONFIG = load_config("simulated", ()).config


class Served:
    """A server in a thread, of rows that a test writes; axes are 1 rad apart."""

    def __init__(self, axes: Sequence[str] = ("",)) -> None:
        config = load_config("simulated", ()).config
        self.telemetry = Telemetry.create(len(axes))
        self.telemetry.words[Word.BEGAN_NS] = BEGAN_NS
        self.hand = SharedHand.create()
        self.views = {
            name: View(
                config,
                "a run",
                RunningSource(self.telemetry, config.period_ns, index),
                recorded=False,
                hand=self.hand,
            )
            for index, name in enumerate(axes)
        }
        self.view = self.views[axes[0]]
        listener = socket.create_server(("127.0.0.1", 0))
        self.place = f"127.0.0.1:{listener.getsockname()[1]}"
        self._over = False
        self.server = server = LiveServer(self.views, "127.0.0.1", TOKEN)
        self._thread = threading.Thread(
            target=lambda: asyncio.run(server.run(listener, lambda: self._over))
        )
        self._thread.start()
        self._count = 0

    def write(self, count: int) -> None:
        for k in range(self._count, self._count + count):
            at = BEGAN_NS + 1_000_000 * k
            for axis in range(self.telemetry.axes):
                position = axis + 0.001 * k
                self.telemetry.write(*row(stiffness=8.0, deadline_ns=at, position=position))
        self._count += count

    def connect(self, query: str = "", **options: Any) -> ClientConnection:
        client: ClientConnection = connect(
            f"ws://{self.place}/rows{query}", compression=None, **options
        )
        return client

    def close(self) -> None:
        self._over = True
        self._thread.join(10.0)
        assert not self._thread.is_alive()


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    made = Served()
    made.write(500)
    yield made
    made.close()


def heard(client: ClientConnection, kind: str) -> dict[str, Any]:
    """The next object of a kind."""
    while True:
        message = client.recv(timeout=10.0)
        if isinstance(message, str) and (found := json.loads(message))["kind"] == kind:
            return dict(found)


def numbers(client: ClientConnection) -> tuple[int, int]:
    """First row and count of the next message of rows."""
    while True:
        message = client.recv(timeout=10.0)
        if isinstance(message, bytes):
            first, count, channels = struct.unpack_from("<dII", message)
            assert channels == len(CHANNELS)
            assert len(message) == 16 + count * (8 + 4 * channels)
            return int(first), count


def test_a_client_gets_what_was_and_what_comes(served: Served) -> None:
    with served.connect() as client:
        hello = heard(client, "hello")
        assert hello["channels"] == list(CHANNELS)
        assert not hello["controls"]
        while isinstance(message := client.recv(timeout=10.0), str):
            pass
        count = struct.unpack_from("<dII", message)[1]
        times = np.frombuffer(message, "<f8", count, 16)
        position = np.frombuffer(message, "<f4", count, 16 + 8 * count)
        assert times == pytest.approx(0.001 * np.arange(count))
        assert position == pytest.approx(0.001 * np.arange(count), rel=1e-6)
        before = count
        served.write(40)
        first, count = numbers(client)
        assert first == before
        assert count > 0


def test_the_page_is_whole_and_small(served: Served) -> None:
    sizes = 0
    for file in sorted(PAGE.iterdir()):
        with urlopen(f"http://{served.place}/{file.name}") as answer:
            content = answer.read()
            assert answer.headers["Content-Security-Policy"].startswith("default-src 'self'")
        assert content == file.read_bytes()
        sizes += len(content)
        assert b"http" not in content.replace(b"http://www.w3.org", b"") or "uPlot" in file.name
    assert sizes < 300_000
    with urlopen(f"http://{served.place}/") as answer:
        assert answer.read() == (PAGE / "index.html").read_bytes()


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("/../server.py", {}, 404),
        ("/", {"Host": "evil.example:80"}, 403),
        ("/rows", {"Origin": "http://evil.example"}, 403),
        ("/rows", {"Host": "[:::"}, 403),
    ],
)
def test_others_are_refused(
    served: Served, path: str, headers: dict[str, str], status: int
) -> None:
    with pytest.raises(HTTPError) as found:
        urlopen(Request(f"http://{served.place}{path}", headers=headers))
    assert found.value.code == status
    found.value.close()


@pytest.mark.parametrize(("token", "controls"), [(TOKEN, True), ("", False)])
def test_the_token_makes_the_difference(served: Served, token: str, controls: bool) -> None:
    with served.connect(f"?token={token}" if token else "") as client:
        assert heard(client, "hello")["controls"] is controls


@pytest.mark.parametrize("token", [TOKEN[:-1], "ü"])
def test_a_wrong_token_closes_the_door(served: Served, token: str) -> None:
    from urllib.parse import quote

    with served.connect(f"?token={quote(token)}") as client:
        with pytest.raises(ConnectionClosed):
            client.recv(timeout=10.0)
        assert client.close_code == 1008


@pytest.fixture
def run(served: Served, tmp_path: Path) -> Iterator[socket.socket]:
    """The end at which a run takes changes."""
    path = tmp_path / "run.sock"
    with listening(path) as listener:
        listener.settimeout(10.0)
        listener.setblocking(True)
        served.server.run_socket = path
        yield listener
    served.server.run_socket = None


def asked(listener: socket.socket) -> tuple[socket.socket, Any]:
    connection, _ = listener.accept()
    connection.settimeout(10.0)
    return connection, json.loads(connection.recv(65536))


def test_a_change_goes_to_the_run_and_its_answers_come_back(
    served: Served, run: socket.socket
) -> None:
    with served.connect(f"?token={TOKEN}") as client:
        client.send(json.dumps({"set": {"wall.stiffness": 4.5, "wall.law": "spring"}, "id": 7}))
        connection, request = asked(run)
        with connection:
            assert request["set"] == ["wall.stiffness=4.5", 'wall.law="spring"']
            connection.sendall(b'{"waits": "for you"}\n')
            answer = heard(client, "answer")
            assert (answer["id"], answer["waits"]) == (7, "for you")
            client.send(json.dumps({"set": {"wall.stiffness": 5}, "id": 8}))
            assert connection.recv(10) == b"", "the newer wish withdraws the older one"
        connection, _ = asked(run)
        with connection:
            connection.sendall(b'{"applied": true}\n')
            assert heard(client, "answer") == {"kind": "answer", "id": 8, "applied": True}
        client.send(json.dumps({"set": {"wall.damping": 0.1}, "id": 9}))
        connection, _ = asked(run)
    with connection:
        assert connection.recv(10) == b"", "a page that has gone wishes nothing"


def until(condition: Callable[[], bool]) -> None:
    end_s = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.005)


def held(served: Served) -> float | None:
    """Where the hand goes; None: it does not hold on."""
    grasp = served.hand.look(time.monotonic_ns())
    return None if grasp is None else grasp.target


def test_one_hand_holds_the_shaft_and_lets_go_with_its_page(served: Served) -> None:
    hold = '{"hand": {"position": 0.25, "stiffness": 4}}'
    other = '{"hand": {"position": 0.5, "stiffness": 4}}'
    with served.connect(f"?token={TOKEN}") as late, served.connect() as reader:
        with served.connect(f"?token={TOKEN}") as client:
            heard(client, "hello")
            client.send(hold)
            until(lambda: held(served) == 0.25)
            reader.send(other)
            assert "may not change the wall" in heard(reader, "refused")["words"]
            client.send(hold)
            late.send(other)
            client.send('{"hand": null}')
            until(lambda: held(served) is None)
            client.send(hold)
            until(lambda: held(served) == 0.25)
        until(lambda: held(served) is None)
        late.send(other)
        until(lambda: held(served) == 0.5)
        until(lambda: held(served) is None)  # it says nothing any more


def test_a_page_that_answers_the_beats_holds_the_dead_man_until_it_goes(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = served.telemetry.words
    words[Word.HELD_NS] = 0
    monkeypatch.setattr(served.view, "dead_man", DeadMan(words))
    with served.connect() as reader, served.connect(f"?token={TOKEN}") as client:
        beat = heard(client, "beat")["beat"]
        reader.send(json.dumps({"hold": beat}))
        assert "may not change the wall" in heard(reader, "refused")["words"]
        assert words[Word.HELD_NS] == 0
        client.send(json.dumps({"hold": heard(client, "beat")["beat"]}))
        until(lambda: words[Word.HELD_NS] > 0)
        client.send('{"hold": null}')
        until(lambda: words[Word.HELD_NS] == 0)
        client.send(json.dumps({"hold": heard(client, "beat")["beat"]}))
        until(lambda: words[Word.HELD_NS] > 0)
    until(lambda: words[Word.HELD_NS] == 0)


@pytest.fixture
def unhurt(
    served: Served, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> Iterator[None]:
    """Strangers come: the server says nothing aloud, raises nothing, and serves others on."""
    with served.connect(f"?token={TOKEN}") as honest:
        yield
        served.write(5)
        numbers(honest)
    with served.connect(f"?token={TOKEN}") as late:
        assert heard(late, "hello")["controls"]
    assert [each for each in caplog.get_records("call") if strangers.is_ours(each)] == []
    assert capfd.readouterr() == ("", "")


@pytest.mark.usefixtures("unhurt")
def test_no_request_of_a_stranger_harms_the_server(served: Served) -> None:
    one_each = [f"GET {target} HTTP/1.1\r\nHost: {served.place}" for target in strangers.TARGETS]
    one_each += [f"GET /rows HTTP/1.1\r\n{header}" for header in strangers.HEADERS]
    for text in one_each:
        strangers.send(served.place, text.encode() + b"\r\n\r\n")
    for query in ("", f"?token={TOKEN}"):
        for frame in strangers.FRAMES:
            strangers.send(served.place, strangers.opened_and(frame, served.place, query))


@pytest.mark.parametrize("query", [f"?token={TOKEN}", ""])
@pytest.mark.usefixtures("unhurt")
def test_no_message_harms_the_server_and_none_is_read_without_the_token(
    served: Served, run: socket.socket, query: str
) -> None:
    end = '"the end"'
    words: set[str] = set()
    messages = [
        f'{{"set": {{"{name}": {value}}}, "id": {value}, "{name}": {value}}}'[:4000]
        for name in strangers.NAMES
        for value in strangers.VALUES
    ]
    run.settimeout(0.0)
    with served.connect(query) as client:
        for begin in range(0, len(messages), 40):
            batch = [*messages[begin : begin + 40], end]
            for each in batch:
                client.send(each)
            for _ in batch:
                words.add(said := heard(client, "refused")["words"])
                if end in said:
                    break
            words.discard(f"not understood: {end!r}")
            with contextlib.suppress(BlockingIOError):
                while True:
                    run.accept()[0].close()
                    assert query, "without the token nothing reaches the run"
    if query:
        assert all(each.startswith("not understood: ") for each in words)
    else:
        assert words == {"this page may not change the wall"}


def test_a_page_looks_at_one_axis_and_sees_the_state_of_all(tmp_path: Path) -> None:
    served = Served(["elbow", "wrist"])
    try:
        served.write(50)
        with served.connect(f"?token={TOKEN}") as client:
            hello = heard(client, "hello")
            assert (hello["axes"], hello["axis"]) == (["elbow", "wrist"], "elbow")
            assert heard(client, "wall")["delay_steps"] is None  # no knob
            strip = heard(client, "strip")["axes"]
            assert [each["name"] for each in strip] == ["elbow", "wrist"]
            assert [each["position"] for each in strip] == pytest.approx([0.049, 1.049])
            client.send(json.dumps({"axis": "wrist"}))
            hello = heard(client, "hello")
            assert hello["axis"] == "wrist"
            while isinstance(message := client.recv(timeout=10.0), str):
                pass
            _, count, _ = struct.unpack_from("<dII", message)
            assert np.frombuffer(message, "<f4", 1, 16 + 8 * count) == pytest.approx(1.0)
            client.send(json.dumps({"axis": "knee"}))
            assert "not understood" in heard(client, "refused")["words"]
            with listening(tmp_path / "run") as listener:
                listener.settimeout(10.0)
                served.server.run_socket = tmp_path / "run"
                client.send(json.dumps({"set": {"wall.stiffness": 3}}))
                with listener.accept()[0] as run:
                    asked = json.loads(run.recv(9999))["set"]
                    assert asked == ["axes.wrist.wall.stiffness=3"]
    finally:
        served.close()
