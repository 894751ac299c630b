"""The command ``haptic-wall``, called in this process or started as a program; and Python."""

import contextlib
import gc
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import pytest

from haptic_wall.controller.cli.main import main
from tests.typed import not_none, status_of

T = TypeVar("T")
Process = subprocess.Popen[str]
PROGRAM = [sys.executable, "-m", "haptic_wall.controller.cli.main"]


LAUNCHER = str(Path(sys.executable).with_name("haptic-wall"))
"""The command as it is installed: it heeds a Ctrl-C from its first instant"""


def python(*words: object, **more: Any) -> subprocess.CompletedProcess[str]:
    """Run Python with these words to its end; what it says is kept."""
    return subprocess.run(
        [sys.executable, *map(str, words)], capture_output=True, text=True, check=False, **more
    )


def call(*words: object) -> int:
    """Call the command with these words; return its exit status."""
    try:
        return main([str(word) for word in words])
    except SystemExit as ended:
        return status_of(ended)
    finally:
        gc.enable()  # a run switches it off


class Answer(NamedTuple):
    """What a command answered."""

    status: int
    out: str
    err: str


class Cli:
    """``haptic-wall``, as a function of its words."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *words: object) -> Answer:
        """Call it, whatever has been said before."""
        self._capsys.readouterr()
        return Answer(call(*words), *self._capsys.readouterr())

    def json(self, *words: object, status: int = 0) -> dict[str, Any]:
        """Return its answer with ``--json``, which holds no NaN."""
        answer = self(*words, "--json")
        assert answer.status == status, answer.err
        found: dict[str, Any] = json.loads(answer.out, parse_constant=pytest.fail)
        return found

    def refused(self, *words: object) -> str:
        """Return what it says of wrong words: status 2, and no answer but that with ``--json``."""
        status, out, err = self(*words)
        assert status == 2
        assert json.loads(out)["exit_status"] == 2 if "--json" in words else out == ""
        assert "Traceback" not in err
        return err


@contextlib.contextmanager
def started(
    *words: object, cwd: Path | None = None, program: Sequence[str] = PROGRAM, **more: Any
) -> Iterator[Process]:
    """The command in a session of its own, which is killed at the end."""
    process = subprocess.Popen(
        [*program, *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=cwd,
        start_new_session=True,
        **more,
    )
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        not_none(process.stdout).close()
        not_none(process.stderr).close()


def children(pid: int) -> dict[str, int]:
    """The children of a process by the module they run."""
    found: dict[str, int] = {}
    tasks = Path(f"/proc/{pid}/task/{pid}/children")
    with contextlib.suppress(FileNotFoundError), tasks.open() as file:
        for child in file.read().split():
            # Gone by now, or not yet the program it is going to be.
            with contextlib.suppress(FileNotFoundError, ValueError):
                words = Path(f"/proc/{child}/cmdline").read_text().split("\0")
                found[words[words.index("-m") + 1].rpartition(".")[2]] = int(child)
    return found


def wait_for(condition: Callable[[], T | None], what: str, timeout_s: float = 60.0) -> T:
    """Wait until a condition holds, and return its result; fail if it takes too long."""
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        if result := condition():
            return result
        time.sleep(0.02)
    raise AssertionError(f"waited {timeout_s} s for {what}")
