"""Who else opens a port in mid-run is refused, or found and named; whom the run started is not."""

import os
import pty
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from haptic_wall.controller.doctor.adapter import examine_port
from haptic_wall.hw.errors import PortBusyError
from haptic_wall.hw.serialport.port import open_port
from haptic_wall.hw.serialport.users import LOOKS, PortUsers, exclusive, holder
from tests.typed import not_none

OPENER = """
import os, sys
held = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
print("held", flush=True)
sys.stdin.read()
"""
AS_NOBODY = "import os\nos.setgroups([]); os.setgid(65534); os.setuid(65534)\n"


class Port:
    """An open pseudo-terminal that is watched."""

    def __init__(self) -> None:
        self.far, self.near = pty.openpty()
        self.path = os.ttyname(self.near)
        self.users = PortUsers(self.near)

    def looks(self, count: int) -> str:
        return next(filter(None, (self.users.look() for _ in range(count))), "")

    def close(self) -> None:
        self.users.close()
        os.close(self.near)
        os.close(self.far)


@pytest.fixture
def port() -> Iterator[Port]:
    made = Port()
    yield made
    made.close()


@contextmanager
def opened_by_another(path: str) -> Iterator[None]:
    """A process that is no child of this one has it open."""
    program = f"import os\nif os.fork(): os._exit(0)\n{OPENER}"
    with subprocess.Popen(
        [sys.executable, "-c", program, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert not_none(other.stdout).readline() == b"held\n"
        other.wait()  # so what holds the port has lost its parent
        yield
        not_none(other.stdin).close()
        not_none(other.stdout).read()


def test_another_program_is_named_soon_after_it_has_opened_the_port(port: Port) -> None:
    port.looks(LOOKS // 3)
    with opened_by_another(port.path):
        found = port.looks(2 * LOOKS)
        assert found.startswith("python")
        assert f"has opened {port.path}" in found
        assert port.users.look_everywhere() == found


def test_what_the_run_has_started_itself_is_nobody(port: Port) -> None:
    """The loop inherits the descriptor, and so does for a moment whatever else is started."""
    with subprocess.Popen(
        [sys.executable, "-c", "import sys; sys.stdin.read()"],
        stdin=subprocess.PIPE,
        pass_fds=(port.near,),
    ) as child:
        assert holder(child.pid, os.fstat(port.near).st_rdev) is not None
        assert port.looks(2 * LOOKS) == port.users.look_everywhere() == ""
        not_none(child.stdin).close()


def test_nobody_of_ours_opens_a_port_that_is_in_use(port: Port) -> None:
    """`doctor` and a second `run` would else disturb the first, and end it."""
    with opened_by_another(port.path):
        users = PortUsers(port.near)
        *_, used_by = examine_port(port.path)
        assert (used_by.name, used_by.ok) == ("used by", False)
        assert used_by.found.startswith("python")
        with pytest.raises(PortBusyError, match="is used by python"):
            open_port(port.path, 1_000_000)
        users.close()


def may_open(path: str) -> bool:
    """Whether somebody without rights may open a device."""
    program = f"{AS_NOBODY}os.close(os.open({path!r}, os.O_RDWR | os.O_NOCTTY))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False)
    return done.returncode == 0


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")
def test_exclusive_use_refuses_others_and_is_released(port: Port) -> None:
    Path(port.path).chmod(0o666)
    assert may_open(port.path), "no exclusive use of a pseudo-terminal: it would outlive its user"
    exclusive(port.near, True)
    assert not may_open(port.path)
    port.users.close()
    assert may_open(port.path)
