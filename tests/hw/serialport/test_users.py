"""Programs that have a port open are named; others cannot open it during a run."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from haptic_wall.hw.errors import PortBusyError
from haptic_wall.hw.serialport import users
from haptic_wall.hw.serialport.port import open_port
from tests.hw.conftest import Terminal
from tests.typed import not_none

OPENER = """
import os, sys
held = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
print("held", flush=True)
sys.stdin.read()
"""
AS_NOBODY = "import os\nos.setgroups([]); os.setgid(65534); os.setuid(65534)\n"


@contextmanager
def opened_by_another(path: str) -> Iterator[None]:
    """A process has it open."""
    with subprocess.Popen(
        [sys.executable, "-c", OPENER, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert not_none(other.stdout).readline() == b"held\n"
        yield
        not_none(other.stdin).close()


def test_nobody_of_ours_opens_a_port_that_is_in_use(terminal: Terminal) -> None:
    """`doctor` and a second `run` would else disturb the first."""
    with opened_by_another(terminal.path), pytest.raises(PortBusyError, match="by python"):
        open_port(terminal.path, 1_000_000)


def may_open(path: str) -> bool:
    """Whether somebody without rights may open a device."""
    program = f"{AS_NOBODY}os.close(os.open({path!r}, os.O_RDWR | os.O_NOCTTY))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False)
    return done.returncode == 0


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")
def test_a_reserved_port_refuses_others_and_is_released(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path(terminal.path).chmod(0o666)
    with users.reserved(terminal.near):
        assert may_open(terminal.path), "no pseudo-terminal: it would outlive its user"
    monkeypatch.setattr(users, "is_pseudo", lambda _device: False)
    with users.reserved(terminal.near):
        assert not may_open(terminal.path)
    assert may_open(terminal.path)


def test_what_is_no_port_is_left_alone(tmp_path: Path) -> None:
    with (tmp_path / "file").open("w") as file, users.reserved(file.fileno()):
        pass
