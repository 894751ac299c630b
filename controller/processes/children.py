"""Starts child processes with their orders, watches them by pidfd and reads their output lines."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from haptic_wall.controller.system.signals import held_back

KILLED_S = 2.0
"""Time allowed for a killed process to disappear [s]"""
HALTED_S = 0.8
"""Time after which a process that a signal has stopped counts as halted [s]"""
_DOING = {
    "R": "was busy",
    "S": "waited for something",
    "D": "waited for a disk or a device",
    "T": "was stopped by a signal",
    "t": "was stopped by a debugger",
}
"""Descriptions of the process states in /proc, by letter"""


_OF_THE_TERMINAL = (signal.SIGINT, signal.SIGHUP, signal.SIGTSTP)
"""Signals that the terminal sends to its foreground process group"""


class Child:
    """A child process in a process group of its own, so that a Ctrl-C reaches only its parent.

    The terminal's signals are blocked while the child starts, before it has left the terminal's
    group; they stay blocked unless the child unblocks them. The child inherits neither real-time
    scheduling nor the parent's core: it is placed on ``cores``.

    Args:
        name: Name of the process, for messages.
        arguments: After ``python -m``.
        orders: Sent as one JSON line on its standard input; None: no input.
        descriptors: File descriptors that it inherits.
        cores: Cores on which it may run.

    Attributes:
        pidfd: Becomes readable when it ends.
        output: Its standard output, non-blocking.
    """

    def __init__(
        self,
        name: str,
        arguments: Sequence[str],
        orders: dict[str, Any] | None,
        descriptors: Sequence[int] = (),
        cores: set[int] | None = None,
    ) -> None:
        self.name = name
        with held_back(_OF_THE_TERMINAL):
            self._process = subprocess.Popen(
                # -P: Python must not import modules from the user's current folder.
                [sys.executable, "-P", "-m", *arguments],
                stdin=subprocess.DEVNULL if orders is None else subprocess.PIPE,
                stdout=subprocess.PIPE,
                pass_fds=descriptors,
                process_group=0,
                bufsize=0,
            )
        self.pid = self._process.pid
        if cores:
            os.sched_setaffinity(self.pid, cores)
        self.pidfd = os.pidfd_open(self.pid)
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.write((json.dumps(orders) + "\n").encode())
            self._process.stdin.close()
        assert self._process.stdout is not None
        self.output = self._process.stdout.fileno()
        os.set_blocking(self.output, False)
        self._heard = b""
        self._went_s = time.monotonic()

    def lines(self) -> list[str]:
        """Return the whole lines that it has written since the last call; never waits."""
        with contextlib.suppress(BlockingIOError):
            while chunk := os.read(self.output, 65536):
                self._heard += chunk
        *lines, self._heard = self._heard.split(b"\n")
        return [line.decode(errors="replace") for line in lines]

    def said(self) -> list[dict[str, Any]]:
        """Return the messages that it has sent since the last call; never waits."""
        return [json.loads(line) for line in self.lines()]

    def ended(self) -> bool:
        """Whether it has ended."""
        return self._process.poll() is not None

    def well(self) -> bool:
        """Whether it has ended without error."""
        return self._process.returncode == 0

    def doing(self) -> str:
        """Return its present state, as words after "it"; empty: unknown."""
        try:
            stat = Path(f"/proc/{self.pid}/stat").read_text()
        except OSError:
            return ""
        return _DOING.get(stat[stat.rindex(")") + 2], "")

    def halted(self) -> bool:
        """Whether it was stopped by a signal at each look of the last ``HALTED_S``."""
        now_s = time.monotonic()
        if self.doing() != _DOING["T"]:
            self._went_s = now_s
        return now_s - self._went_s > HALTED_S

    def exit_text(self) -> str:
        """Describe how it ended, for messages."""
        code = self._process.returncode
        if code is None:
            return "is running"
        names = {each.value: each.name for each in signal.Signals}  # not all have one
        how = names.get(-code, f"signal {-code}")
        return f"was killed by {how}" if code < 0 else f"ended with {code}"

    def wait(self, timeout_s: float) -> bool:
        """Wait for its end; return whether it ended in time."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout_s)
        return self.ended()

    def send(self, number: signal.Signals) -> None:
        """Send it a signal; no effect after it has ended."""
        if not self.ended():
            self._process.send_signal(number)

    def dismiss(self, timeout_s: float) -> None:
        """End it: by request, and by force after ``timeout_s`` [s]; close its descriptors."""
        self.send(signal.SIGTERM)
        if self.doing() == _DOING["T"] or not self.wait(timeout_s):  # it cannot heed a request
            self.send(signal.SIGKILL)
            self.wait(KILLED_S)  # a process that waits for a device in the kernel cannot be killed
        if self._process.stdout is not None and not self._process.stdout.closed:
            self._process.stdout.close()
            os.close(self.pidfd)


def first_line(
    child: Child, timeout_s: float, given_up: Callable[[], bool] = lambda: False
) -> str | None:
    """Return the first line that a child writes; None: it wrote nothing, or is halted.

    Args:
        child: The child.
        timeout_s: Longest wait [s].
        given_up: Whether to stop waiting.
    """
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline and not given_up() and not child.halted():
        ended = child.ended()  # asked first: it may write a line and end between the two calls
        lines = child.lines()
        if lines:
            return lines[0]
        if ended:
            return None
        time.sleep(0.005)
    return None


@contextlib.contextmanager
def on_cores(cores: set[int]) -> Iterator[None]:
    """Keep this process on some cores: off the loop's, which a hung real-time loop occupies."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
