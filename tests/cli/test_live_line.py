"""The line of a terminal while a run goes on."""

import os
import pty
import select
import subprocess
import termios
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.cli.live_line import line_of, worst_of
from haptic_wall.controller.detector.state import State
from haptic_wall.controller.runtime.telemetry import FLAG_CONTACT, ROW
from tests.cases import whole_only
from tests.support.program import LAUNCHER


def row(**fields: float) -> Any:
    made = np.zeros(1, ROW)
    made["position"], made["torque"], made["stiffness"], made["age_ns"] = 0.1, -0.5, 8.0, 420_000
    made["flags"] = FLAG_CONTACT
    for name, value in fields.items():
        made[name] = value
    return made[0]


def line(given: Any, columns: int) -> str:
    return line_of(given, 3, loses=False, columns=columns)


def test_the_line_names_what_a_person_wants_to_know() -> None:
    told = line(row(), 200)
    for word in ("contact", "-0.500 N·m", "+0.1000 rad", "K 8", "lost 3", "0.42 ms"):
        assert word in told
    assert line(row(), 30) == "contact    -0.500 N·m"
    assert line(row(), 10) == "contact  "
    assert line(row(oscillation=State.GROWING), 200).startswith("growing")


def test_of_several_axes_the_worst_is_shown() -> None:
    rows = [row(torque=0.1), row(torque=-0.9), row(torque=0.0)]
    assert worst_of(rows, [0, 0, 0]) == 1
    assert worst_of(rows, [0, 0, 4]) == 2, "it loses readings"
    assert worst_of([row(oscillation=State.SUSTAINED), *rows], [0, 0, 0, 4]) == 0


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
    command = [LAUNCHER, "run", "simulated"]
    command += ["--set", "realtime.profile=off", "--duration", "60", "--no-plot"]
    run = subprocess.Popen(
        command, stdin=theirs, stdout=theirs, stderr=theirs, cwd=tmp_path, start_new_session=True,
        preexec_fn=lambda: os.close(os.open(os.ttyname(theirs), os.O_RDWR)),  # noqa: PLW1509 - it takes the terminal
        env={**os.environ, "TERM": "xterm"},
    )  # fmt: skip
    try:
        seen = b""
        end = time.monotonic() + 60.0
        while b" rad  K" not in seen and time.monotonic() < end:
            if select.select([ours], [], [], 1.0)[0]:
                seen += os.read(ours, 65536)
        assert b" rad  K" in seen, seen
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
