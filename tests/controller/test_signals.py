"""Which signals ask a run to stop."""

import signal
import subprocess
import sys

SAYS = "from controller.signals import STOPPING; print(*(each.name for each in STOPPING))"


def begun(ignores):
    """What a program heeds that begins with the terminal's end ignored, as by nohup, or not."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN if ignores else signal.SIG_DFL)
    try:
        done = subprocess.run(
            [sys.executable, "-c", SAYS], capture_output=True, text=True, check=True
        )
    finally:
        signal.signal(signal.SIGHUP, before)
    return done.stdout.split()


def test_the_closed_terminal_ends_a_run_but_not_one_that_nohup_began():
    assert begun(ignores=False) == ["SIGINT", "SIGTERM", "SIGHUP"]
    assert begun(ignores=True) == ["SIGINT", "SIGTERM"]
