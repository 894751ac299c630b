"""``demo``: what it refuses, that Ctrl-C ends all of it, and that an ended run comes back."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from click.testing import CliRunner

from haptic_wall.controller.cli import demo
from haptic_wall.controller.errors import HapticWallError
from tests.cases import whole_only

COMMAND = [sys.executable, "-m", "haptic_wall.controller.cli.main", "demo"]


def refusal(*arguments: str) -> str:
    done = CliRunner().invoke(demo.command, [*arguments])
    assert isinstance(done.exception, HapticWallError), done.output
    return str(done.exception)


def test_a_place_that_is_none_or_taken_is_refused_before_anything_starts() -> None:
    assert refusal("--at", "localhost").startswith("--at")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        said = refusal("--at", f"127.0.0.1:{taken.getsockname()[1]}")
    assert "localhost:0 for a free one" in said


def members(session: int) -> list[int]:
    """The processes of a session."""
    found = []
    for each in Path("/proc").iterdir():
        if each.name.isdigit():
            with suppress(OSError):
                fields = (each / "stat").read_text().rpartition(")")[2].split()
                if int(fields[3]) == session and fields[0] != "Z":
                    found.append(int(each.name))
    return found


@contextmanager
def demonstration(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """The command, in a session of its own; nothing of it may be left."""
    child = subprocess.Popen(
        COMMAND,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "TMPDIR": str(folder)},
    )
    try:
        yield child
    finally:
        if child.poll() is None:
            child.kill()
        child.communicate()
        end_s = time.monotonic() + 10.0
        while members(child.pid) and time.monotonic() < end_s:
            time.sleep(0.02)
        left = members(child.pid)
        for pid in left:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        assert left == []


@pytest.mark.realtime
@pytest.mark.parametrize("wait_s", [whole_only(0.8), 1.5])
def test_ctrl_c_while_it_starts_ends_all_of_it(tmp_path: Path, wait_s: float) -> None:
    with demonstration(tmp_path) as child:
        time.sleep(wait_s)
        os.killpg(child.pid, signal.SIGINT)
        _, said = child.communicate(timeout=30.0)
    assert child.returncode == 130
    assert said.strip() == ""
    assert list(tmp_path.iterdir()) == []
