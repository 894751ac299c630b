"""``run --live`` and ``live``: what they refuse, and that the page's end is not the run's."""

from __future__ import annotations

import json
import os
import signal
import socket
from pathlib import Path

import pytest
from websockets.sync.client import connect

from haptic_wall.controller.live.place import live_at
from tests.controller.live import strangers
from tests.support.program import Cli, children, started


def test_a_taken_port_is_refused_before_anything_starts(cli: Cli) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        said = cli.refused("run", "--live", f"127.0.0.1:{taken.getsockname()[1]}")
    assert "Address already in use" in said
    assert "localhost:0 for a free one" in said


def test_a_token_only_where_knobs_may_be_turned() -> None:
    reading, turning = live_at("127.0.0.1:0"), live_at("[::1]:0", control=True)
    for place in (reading, turning):
        os.close(place.descriptor)
    assert reading.token == ""
    assert reading.address.endswith("/")
    assert len(turning.token) >= 20
    assert turning.address.startswith("http://[::1]:")
    assert turning.address.endswith(f"/?token={turning.token}")


@pytest.mark.whole
@pytest.mark.realtime
def test_a_killed_page_changes_nothing_for_the_run(tmp_path: Path) -> None:
    words = ["simulated", "--live", "--duration", 4, "--no-plot", "--json", "--log", tmp_path / "a"]
    with started("run", *words) as child:
        assert child.stdout is not None and child.stderr is not None
        address = next(line for line in child.stderr if line.startswith("live: "))[6:].strip()
        with connect(f"{address.replace('http', 'ws')}rows", open_timeout=60.0) as client:
            while isinstance(client.recv(timeout=60.0), str):
                pass
            strangers.send(address.partition("//")[2].rstrip("/"), b"GET //[ HTTP/1.1\r\n\r\n")
            client.send('{"set": {"wall.law": []}}')
            while "may not change the wall" not in str(client.recv(timeout=60.0)):
                pass
            os.kill(children(child.pid)["door"], signal.SIGKILL)
        report = json.loads(child.stdout.read())
        said = child.stderr.read()
        child.wait()
    assert child.returncode == 0
    assert report["stop_reason"] == "duration"
    assert report["ticks"] + report["missed_ticks"] >= 4000
    assert "for changes and page was killed by SIGKILL; the run goes on without it" in said
    assert "refused" not in said and "Traceback" not in said
