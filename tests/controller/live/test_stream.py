"""Rows sent live arrive as PlotJuggler reads them, and a network that fails disturbs nothing."""

import json
import math
import socket
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from haptic_wall.controller.cli.run import command
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.live.stream import Sender, Stream, stream_to
from haptic_wall.controller.logs.columns import COLUMNS
from haptic_wall.controller.runtime.telemetry import ROW, Row, Telemetry


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plot:
        plot.bind(("127.0.0.1", 0))
        plot.settimeout(20.0)
        yield plot


def heard(plot: socket.socket) -> list[bytes]:
    """All that has arrived."""
    plot.setblocking(False)
    datagrams = []
    try:
        while True:
            datagrams.append(plot.recv(65536))
    except BlockingIOError:
        return datagrams


def write(telemetry: Telemetry, count: int, start: int = 0) -> None:
    """Rows a millisecond apart; the first without a position."""
    for k in range(start, start + count):
        row = np.zeros((), ROW)
        row["deadline_ns"] = 8_000_000_000 + 1_000_000 * k
        row["position"] = math.nan if k == 0 else 0.1 * k
        row["lateness_ns"], row["measured_torque"] = 2_500, math.nan
        telemetry.write(Row(*row.tolist()[1:]))


@pytest.fixture
def sender(listener: socket.socket) -> Iterator[tuple[Telemetry, Sender]]:
    telemetry = Telemetry.create()
    made = Sender(telemetry, Stream("127.0.0.1", listener.getsockname()[1], 100.0), 1000.0)
    yield telemetry, made
    made.close()


def test_rows_arrive_one_object_each_on_a_coarser_grid(
    listener: socket.socket, sender: tuple[Telemetry, Sender]
) -> None:
    telemetry, made = sender
    write(telemetry, 15)
    assert made.send() == []
    write(telemetry, 20, 15)
    assert made.send() == []
    datagrams = heard(listener)
    rows = [json.loads(datagram) for datagram in datagrams]
    assert [row["timestamp"] for row in rows] == [0.0, 0.01, 0.02, 0.03]
    assert "position_rad" not in rows[0]  # not known yet, and JSON has no NaN
    assert [row["position_rad"] for row in rows[1:]] == pytest.approx([1.0, 2.0, 3.0])
    assert rows[1]["lateness_us"] == 2.5
    assert set(rows[1]) == {"timestamp", *COLUMNS} - {"time_s", "sampled_s", "measured_torque_nm"}
    assert all(isinstance(value, int | float) for row in rows for value in row.values())
    assert max(map(len, datagrams)) < 1400, "fits a packet, and PlotJuggler's buffer of 2048"


def test_nobody_listening_is_said_once_and_sending_goes_on(
    listener: socket.socket, sender: tuple[Telemetry, Sender]
) -> None:
    telemetry, made = sender
    address = listener.getsockname()
    listener.close()
    said = []
    for start in range(0, 300, 50):
        write(telemetry, 50, start)
        said += made.send()
    (sentence,) = said
    assert f"127.0.0.1 port {address[1]} cannot be reached (Connection refused)" in sentence
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as later:
        later.bind(address)
        for start in (300, 350):  # the first may still get the old refusal
            write(telemetry, 50, start)
            assert made.send() == []
        assert heard(later)


@pytest.mark.parametrize(
    ("place", "rate", "said"),
    [
        ("localhost", 100.0, "found 'localhost', wanted HOST:PORT"),
        ("localhost:0", 100.0, "a port of 1 to 65535"),
        ("localhost:99999", 100.0, "a port of 1 to 65535"),
        ("::1:9870", 100.0, "wanted HOST:PORT"),
        ("a..b:9870", 100.0, "the host a..b is not known"),
        ("localhost:9870", 0.0, "--stream-rate: found 0, wanted a rate above 0 Hz"),
        ("localhost:9870", math.nan, "--stream-rate: found nan"),
    ],
)
def test_a_place_that_is_none_is_refused(place: str, rate: float, said: str) -> None:
    with pytest.raises(UserError, match=said):
        stream_to(place, rate, anywhere=True)


def test_places() -> None:
    assert stream_to("127.0.0.1:9870", 250.0, False) == Stream("127.0.0.1", 9870, 250.0)
    assert stream_to("[::1]:9870", 100.0, False).host == "::1"
    scope = socket.if_nametoindex("lo")
    assert stream_to("[fe80::1%lo]:9870", 100.0, True).host == f"fe80::1%{scope}"


@pytest.mark.parametrize("place", ["localhost", "127.8.8.8", "0.0.0.0", "[::]"])
def test_this_machine_may_listen(place: str) -> None:
    assert stream_to(f"{place}:9870", 100.0, anywhere=False).port == 9870


@pytest.mark.parametrize(
    "place",
    ["192.0.2.7", "239.1.2.3", "255.255.255.255", "[2001:db8::7]", "[ff02::1%lo]", "[fe80::7%lo]"],
)
def test_another_machine_is_asked_for(place: str) -> None:
    """These are addresses of documentation, of groups, and of everybody."""
    with pytest.raises(UserError, match=r"is not this machine.*add --stream-anywhere to"):
        stream_to(f"{place}:9870", 100.0, anywhere=False)
    assert stream_to(f"{place}:9870", 100.0, anywhere=True).port == 9870


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--stream", "localhost:9870", "--set", "loop.clock=simulated"], "loop.clock=monotonic"),
        (["--stream-rate", "50"], "--stream-rate: found without --stream"),
        (["--stream-anywhere"], "--stream-anywhere: found without --stream"),
        (["--stream", "192.0.2.7:9870"], "add --stream-anywhere to allow this"),
        (["--stream", "9870"], "wanted HOST:PORT"),
    ],
)
def test_what_run_refuses(
    arguments: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    refused = CliRunner().invoke(command, arguments)
    assert isinstance(refused.exception, UserError)
    assert said in str(refused.exception)
    assert list(tmp_path.iterdir()) == [], "nothing is made, and no earlier log replaced"
