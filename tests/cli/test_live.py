"""``run --live`` and ``live``: what they refuse, and that the page's end is not the run's."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from random import Random

import pytest
from click.testing import CliRunner
from websockets.sync.client import connect

from haptic_wall.controller.cli import live, run
from haptic_wall.controller.errors import HapticWallError, PlatformError
from haptic_wall.controller.live.place import live_at, server_log_of
from haptic_wall.controller.live.run_socket import MODULE
from haptic_wall.controller.live.web_server import MOST_CHARACTERS, MOST_LINES
from tests.controller.live import strangers


def refusal(command: object, *arguments: str) -> str:
    done = CliRunner().invoke(command, [*arguments])  # type: ignore[arg-type]
    assert isinstance(done.exception, HapticWallError), done.output
    return str(done.exception)


@pytest.mark.parametrize("place", ["simulated", "localhost", "localhost:70000", "a b:1"])
def test_a_place_that_is_none_is_refused(place: str) -> None:
    assert refusal(run.command, "--live", place).startswith("--live")


def test_a_taken_port_is_refused_before_anything_starts() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        said = refusal(run.command, "--live", f"127.0.0.1:{taken.getsockname()[1]}")
    assert "Address already in use" in said
    assert "localhost:0 for a free one" in said


def test_control_without_a_page_and_a_page_without_time_are_refused() -> None:
    assert "add --live" in refusal(run.command, "--live-control")
    assert "before it can be watched" in refusal(
        run.command, "--live", "localhost:0", "--set", "loop.clock=simulated"
    )


def test_without_websockets_the_install_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    with pytest.raises(PlatformError, match=r"pip install -e '\.\[live\]'"):
        live_at("localhost:0")


def test_a_token_only_where_knobs_may_be_turned() -> None:
    reading, turning = live_at("127.0.0.1:0"), live_at("[::1]:0", control=True)
    for place in (reading, turning):
        os.close(place.descriptor)
    assert reading.token == ""
    assert reading.address.endswith("/")
    assert len(turning.token) >= 20
    assert turning.address.startswith("http://[::1]:")
    assert turning.address.endswith(f"/?token={turning.token}")


def test_a_log_that_is_none_is_refused(tmp_path: Path) -> None:
    other = tmp_path / "x.hwlog"
    other.write_text("no log")
    assert "is not a log" in refusal(live.command, str(other))
    assert "cannot be read" in refusal(live.command, str(tmp_path / "none"))


def server_of(parent: int) -> int:
    """The page's process that a run started."""
    for each in Path("/proc").iterdir():
        if each.name.isdigit():
            try:
                words = (each / "cmdline").read_bytes().split(b"\0")
                mine = int((each / "stat").read_text().rpartition(")")[2].split()[1]) == parent
            except OSError:
                continue
            if mine and MODULE.encode() in words:
                return int(each.name)
    raise AssertionError("no page")


@pytest.mark.whole
@pytest.mark.realtime
def test_a_killed_page_changes_nothing_for_the_run(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "haptic_wall.controller.cli.main", "run", "simulated"]
    command += ["--live", "--duration", "4", "--no-plot", "--json", "--log", str(tmp_path / "a")]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout is not None and child.stderr is not None
        address = next(line for line in child.stderr if line.startswith("live: "))[6:].strip()
        with connect(f"{address.replace('http', 'ws')}rows", open_timeout=60.0) as client:
            while isinstance(client.recv(timeout=60.0), str):
                pass
            strangers.send(address.partition("//")[2].rstrip("/"), b"GET //[ HTTP/1.1\r\n\r\n")
            client.send('{"set": {"wall.law": []}}')
            while "may not change the wall" not in str(client.recv(timeout=60.0)):
                pass
            os.kill(server_of(child.pid), signal.SIGKILL)
        report = json.loads(child.stdout.read())
        said = child.stderr.read()
    assert child.returncode == 0
    assert report["stop_reason"] == "duration"
    assert report["ticks"] + report["missed_ticks"] >= 4000
    assert "for changes and page was killed by SIGKILL; the run goes on without it" in said
    assert "refused" not in said and "Traceback" not in said
    assert server_log_of(tmp_path / "a").read_text().count("refused") == 2


@pytest.mark.whole
def test_a_server_says_what_it_refuses_in_short_lines_of_its_own_log_only(tmp_path: Path) -> None:
    log, random = tmp_path / "a.hwlog", Random(7)
    program = [sys.executable, "-m", "haptic_wall.controller.cli.main"]
    made = [*program, "run", "simulated", "--set", "loop.clock=simulated", "--duration", "0.2"]
    subprocess.run([*made, "--no-plot", "--log", str(log)], check=True, capture_output=True)
    with subprocess.Popen(
        [*program, "live", str(log)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout is not None
        address = child.stdout.readline().strip()
        place = address.partition("//")[2].rstrip("/")
        for _ in range(100):
            strangers.send(place, strangers.request(random, place))
        for _ in range(MOST_LINES):
            strangers.send(place, b"GET //[ HTTP/1.1\r\n\r\n")
        with connect(f"ws://{place}/rows") as client:
            assert json.loads(client.recv(timeout=60.0))["kind"] == "hello"
        child.send_signal(signal.SIGINT)
        said = child.communicate(timeout=30.0)
    assert (child.returncode, said) == (130, ("", ""))
    lines = server_log_of(log).read_text().splitlines()
    assert len(lines) == MOST_LINES and max(map(len, lines)) < MOST_CHARACTERS + 30
    assert "Traceback" not in str(lines)
