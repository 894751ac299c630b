"""The supervisor's side of the live page: its process holds no end of a run up."""

from __future__ import annotations

import os
import signal
import socket
import time

import pytest

from haptic_wall.controller.processes import live
from haptic_wall.controller.processes.children import Child


def test_a_stopped_server_is_killed_after_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "_END_S", 0.1)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        server = Child("live page", ["timeit", "-n1", "-r1", "import time; time.sleep(60)"], None)
        os.kill(server.pid, signal.SIGSTOP)
        while server.doing() != "was stopped by a signal":
            time.sleep(0.001)
        monitor = live.LiveMonitor(server, ours, None, lambda _: None)
        began_s = time.monotonic()
        for _ in range(300):  # nothing waits for one that does not read
            monitor.pass_on("x" * 1000)
        monitor.end("duration")
        assert 0.1 <= time.monotonic() - began_s < 2.0
    assert server.exit_text() == "was killed by SIGKILL"
