"""The line of a terminal while a run goes on."""

import os
import pty
import select
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest

from haptic_wall.controller.cli.live_line import Shown, bar_of, line_of
from tests.cases import whole_only

CALM = Shown("contact", 0, 0.1, 0.02, -0.5, 1.0, 8.0, 3, 0.42)


def test_the_line_names_what_a_person_wants_to_know() -> None:
    line = line_of(CALM, 200, colour=True)
    for word in ("contact", "-0.500 N·m", "+0.1000 rad", "+0.0200", "K 8", "lost 3", "0.42 ms"):
        assert word in line
    assert "\x1b" not in line
    assert line_of(CALM, 40, colour=True) == "contact   [   ##|     ]  -0.500 N·m"
    assert line_of(CALM, 10, colour=True) == "contact  "


def test_what_is_wrong_is_coloured_unless_nobody_wants_that() -> None:
    wrong = Shown("growing", 2, 0.1, 0.02, -0.5, 1.0, 8.0, 3, 0.42)
    assert line_of(wrong, 200, colour=True).startswith("\x1b[31m")
    assert "\x1b" not in line_of(wrong, 200, colour=False)


@pytest.mark.parametrize(
    ("torque", "bar"),
    [
        (-1.0, "[#####|     ]"),
        (0.0, "[     |     ]"),
        (0.4, "[     |##   ]"),
        (9.0, "[     |#####]"),
    ],
)
def test_the_bar_points_to_where_the_torque_pushes(torque: float, bar: str) -> None:
    assert bar_of(torque, 1.0) == bar
    assert bar_of(float("nan"), 1.0) == "[     |     ]"


@pytest.mark.whole
@pytest.mark.realtime
@pytest.mark.parametrize(
    "key",
    [
        b" ",
        b"\x1a",
        *(whole_only(key) for key in (b"q", b"\x03")),
    ],
)
def test_a_key_ends_the_run_and_the_terminal_is_as_before(tmp_path: Path, key: bytes) -> None:
    ours, theirs = pty.openpty()
    before = termios.tcgetattr(theirs)
    command = [str(Path(sys.executable).with_name("haptic-wall")), "run", "simulated"]
    command += ["--set", "realtime.profile=off", "--duration", "60", "--no-plot"]
    run = subprocess.Popen(
        command, stdin=theirs, stdout=theirs, stderr=theirs, cwd=tmp_path, start_new_session=True,
        preexec_fn=lambda: os.close(os.open(os.ttyname(theirs), os.O_RDWR)),  # noqa: PLW1509 - it takes the terminal
        env={**os.environ, "TERM": "xterm"},
    )  # fmt: skip
    try:
        seen = b""
        end = time.monotonic() + 60.0
        while b"depth" not in seen and time.monotonic() < end:
            if select.select([ours], [], [], 1.0)[0]:
                seen += os.read(ours, 65536)
        assert b"depth" in seen, seen
        os.write(ours, key)
        while run.poll() is None and time.monotonic() < end:
            if select.select([ours], [], [], 0.2)[0]:
                seen += os.read(ours, 65536)
        assert run.returncode == 130, seen[-2000:]
        assert termios.tcgetattr(theirs) == before
    finally:
        run.kill()
        run.wait()
        os.close(ours)
        os.close(theirs)
