"""What takes long is shown on a terminal, with an estimate, and nowhere else."""

import os
import pty
import sys
import time

import pytest

from haptic_wall.controller.cli.working import Work

PROGRAM = """
import os, signal, sys, time
from haptic_wall.controller.cli import interrupt, options, working
working.FIRST_S = 0.01
interrupt.leave_at_once()
with working.working("drawing", 9.0) as work:
    while not work.drawn:
        time.sleep(0.01)
    {then}
options.say("the end")
"""


def on_a_terminal(then: str) -> tuple[str, int]:
    """What a program writes on a terminal, and its exit status."""
    child, terminal = pty.fork()
    if child == 0:
        os.execv(sys.executable, [sys.executable, "-c", PROGRAM.format(then=then)])
    text = b""
    try:
        while new := os.read(terminal, 4096):
            text += new
    except OSError:  # it is closed
        pass
    os.close(terminal)
    return text.decode(), os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def test_a_ctrl_c_takes_the_line_away() -> None:
    text, status = on_a_terminal("os.kill(os.getpid(), signal.SIGINT); time.sleep(9)")
    assert text.endswith("left\r\x1b[Khaptic-wall: interrupted\r\n")
    assert status == 130


@pytest.mark.parametrize(
    ("about", "share", "passed", "text"),
    [
        (None, None, 3.0, "drawing: 3 s"),
        (10.0, None, 3.0, "drawing: 3 s, about 7 s left"),
        (10.0, None, 12.0, "drawing: 12 s, 10 s were expected"),
        (10.0, 0.0, 3.0, "drawing: 3 s, about 7 s left"),
        (10.0, 0.5, 3.0, "drawing: 3 s, about 3 s left"),
        (None, 0.01, 6.0, "drawing: 6 s, about 10 min left"),
    ],
)
def test_the_estimate_is_by_what_is_done_where_that_is_known(
    about: float | None, share: float | None, passed: float, text: str
) -> None:
    work = Work("drawing", about, share if share is None else lambda: share)
    work.began = time.monotonic() - passed
    assert work.text() == text
