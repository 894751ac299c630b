"""The live page's thread: it serves the page before the run is there."""

from __future__ import annotations

import asyncio
import json
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest
from websockets.sync.client import connect

from haptic_wall.controller.live import page_thread
from haptic_wall.controller.live.place import live_at
from haptic_wall.controller.live.server import LiveServer
from haptic_wall.controller.live.source import RunningSource
from haptic_wall.controller.live.view import View
from haptic_wall.controller.runtime.telemetry import Telemetry
from haptic_wall.controller.settings.load import load_config


def test_the_page_is_served_before_what_is_slow_to_import() -> None:
    """Without these two it starts in a quarter of the time."""
    place = "haptic_wall.controller.live"
    code = f"import sys, {place}.door, {place}.page_thread; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"numpy", "pydantic"} & set(done.stdout.split())


def test_a_page_that_comes_before_the_run_is_greeted_when_it_is_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    config = load_config("simulated", ()).config
    view = View(config, "late", RunningSource(Telemetry.create(), 1_000_000), recorded=False)
    live = live_at("127.0.0.1:0")
    there, over = threading.Event(), threading.Event()

    def imported() -> Callable[..., tuple[LiveServer, Callable[[], bool]]]:
        assert there.wait(20.0)
        return lambda *_: (LiveServer(view, live.host), over.is_set)

    monkeypatch.setattr(page_thread, "_imported", imported)
    monkeypatch.setattr(page_thread, "stand_back", lambda: None)  # of this test's own threads
    orders: dict[str, Any] = {
        "live": {
            "descriptor": live.descriptor,
            "host": live.host,
            "address": live.address,
            "token": "",
        }
    }
    server = threading.Thread(target=lambda: asyncio.run(page_thread.serve(orders, over.is_set)))
    server.start()
    try:
        with urlopen(live.address, timeout=10.0) as page:
            assert b"<title>haptic-wall</title>" in page.read()
        with connect(live.address.replace("http", "ws") + "rows", compression=None) as client:
            with pytest.raises(TimeoutError):
                client.recv(timeout=0.2)
            there.set()
            assert json.loads(client.recv(timeout=10.0))["name"] == "late"
    finally:
        there.set()
        over.set()
        server.join(20.0)
    assert not server.is_alive()
    with pytest.raises(OSError, match="refused"):
        socket.create_connection((live.host, int(Path(live.address).name.rpartition(":")[2])))
