"""A serial port as a line: what opening promises, and what each way of failing says."""

from __future__ import annotations

import grp
import os
import select
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from haptic_wall.hw.clock import MonotonicClock
from haptic_wall.hw.errors import PortError, ServoLostError
from haptic_wall.hw.serialport.line import FdLine
from haptic_wall.hw.serialport.port import open_port
from tests.hw.conftest import Terminal

EVERY_BYTE = bytes(range(256))


def receive(descriptor: int, size: int) -> bytes:
    data = b""
    while len(data) < size and select.select([descriptor], [], [], 5.0)[0]:
        data += os.read(descriptor, 4096)
    return data


@pytest.fixture
def line(terminal: Terminal) -> Iterator[FdLine]:
    opened = FdLine(open_port(terminal.path, 1_000_000), MonotonicClock())
    yield opened
    opened.close()


def test_every_byte_passes_unchanged_both_ways(terminal: Terminal, line: FdLine) -> None:
    line.write(EVERY_BYTE)
    assert receive(terminal.far, 256) == EVERY_BYTE
    os.write(terminal.far, EVERY_BYTE)
    received = b""
    while len(received) < 256 and line.wait(time.monotonic_ns() + 5_000_000_000):
        received += line.read()
    assert received == EVERY_BYTE


def test_what_was_sent_to_the_previous_user_is_not_received(terminal: Terminal) -> None:
    first = open_port(terminal.path, 1_000_000)
    os.write(terminal.far, b"a reply nobody waited for")
    os.close(first)
    line = FdLine(open_port(terminal.path, 1_000_000), MonotonicClock())
    assert line.read() == b""
    line.close()


def test_a_port_that_hangs_up_is_a_lost_servo(terminal: Terminal, line: FdLine) -> None:
    terminal.hang_up()
    assert line.wait(time.monotonic_ns() + 1_000_000_000) is True
    with pytest.raises(ServoLostError, match="port is gone"):
        line.read()
    with pytest.raises(ServoLostError, match="port is gone"):
        line.write(b"x")


def test_a_closed_line_is_lost_and_touches_nobody_elses_file(line: FdLine) -> None:
    line.close()
    readable, writable = os.pipe()  # one of them has the line's old number
    with pytest.raises(ServoLostError):
        line.read()
    os.write(writable, b"somebody else's")
    for use in (lambda: line.wait(0), line.read, lambda: line.write(b"x")):
        with pytest.raises(ServoLostError):
            use()
    assert os.read(readable, 100) == b"somebody else's"
    os.close(readable)
    os.close(writable)


def test_a_port_that_stops_sending_is_a_lost_servo(line: FdLine) -> None:
    with pytest.raises(ServoLostError, match="sent nothing"):
        line.write(bytes(1_000_000))  # nobody reads at the far end


def test_a_missing_port_says_what_there_is() -> None:
    with pytest.raises(PortError, match=r"/dev/ttyNOWHERE does not exist.*name another port"):
        open_port("/dev/ttyNOWHERE", 1_000_000)


def test_a_port_by_another_name_gets_advice() -> None:
    with pytest.raises(PortError, match=r"its whole path.*emulate --link ttyUSB0"):
        open_port("ttyUSB0", 1_000_000)


@pytest.mark.parametrize("kind", ["file", "directory", "null"])
def test_what_is_no_serial_port_is_refused(kind: str, tmp_path: Path) -> None:
    path = tmp_path if kind == "directory" else tmp_path / "file"
    if kind == "file":
        path.write_text("not a port")
    if kind == "null":
        path = Path("/dev/null")
    with pytest.raises(PortError, match="is not a serial port"):
        open_port(str(path), 1_000_000)


def test_a_refused_permission_names_what_grants_it(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", refuse)
    group = grp.getgrgid(Path(terminal.path).stat().st_gid).gr_name
    mode = stat.S_IMODE(Path(terminal.path).stat().st_mode)
    advice = f"usermod -aG {group}" if mode & 0o060 == 0o060 and group != "root" else "chmod a\\+rw"
    with pytest.raises(PortError, match=f"may not be used by this user.*{advice}"):
        open_port(terminal.path, 1_000_000)


def test_the_process_on_the_far_side_does_not_make_the_port_busy() -> None:
    program = (
        "import os, pty, sys\n"
        "far, near = pty.openpty()\n"
        "print(os.ttyname(near), flush=True)\n"
        "sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as emulator:
        assert emulator.stdout is not None
        assert emulator.stdin is not None
        os.close(open_port(emulator.stdout.readline().strip(), 1_000_000))
        emulator.stdin.close()
