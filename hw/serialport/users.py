"""Finds other users of a port, and keeps them off it while it is in use.

A second program on the bus garbles frames and takes replies away. Before a port is opened, the open
files of all processes that this user may see are searched. Then the kernel refuses further openings
(TIOCEXCL), but not those of root, and not on a pseudo-terminal: its users do not close it last, so
that it would stay refused.
"""

from __future__ import annotations

import fcntl
import os
import stat
import termios
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

_PTMX: Final = os.makedev(5, 2)
"""The device behind the controlling end of every pseudo-terminal"""
_PTS_MAJORS: Final = range(136, 144)
"""Major numbers of the devices at the other ends"""


def is_pseudo(device: int) -> bool:
    """Whether a device is the client end of a pseudo-terminal."""
    return os.major(device) in _PTS_MAJORS


def is_terminal(device: int) -> bool:
    """Whether a device is a terminal; other devices may have any number of users.

    The kernel says it: opening a port would disturb its user.
    """
    known = Path(f"/sys/dev/char/{os.major(device)}:{os.minor(device)}/subsystem")
    return is_pseudo(device) or known.resolve().name == "tty"


def holders(device: int) -> Iterator[tuple[int, str]]:
    """Yield pid and program of other processes that have a device open, as far as visible.

    Args:
        device: The device's number (``st_rdev``).
    """
    for pid in _processes():
        if (program := holder(pid, device)) is not None:
            yield pid, program


def holder(pid: int, device: int) -> str | None:
    """Return the program of a process that has a device open; None: it has not, or is not visible.

    A process that also has the controlling end of the pseudo-terminal open is ignored: it is the
    emulator at the other end.

    Args:
        pid: The process.
        device: The device's number (``st_rdev``).
    """
    folder = f"/proc/{pid}/fd"
    try:
        # Paths as objects take twice as long.
        held = {_target(f"{folder}/{entry}") for entry in os.listdir(folder)}  # noqa: PTH208
        if device in held and not (is_pseudo(device) and _PTMX in held):
            return Path(f"/proc/{pid}/comm").read_text().strip()
    except OSError:  # it ended, or belongs to another user
        pass
    return None


@contextmanager
def reserved(descriptor: int) -> Iterator[None]:
    """Have the kernel refuse further openings of a port, except by root, for the time of a block.

    Args:
        descriptor: The open port; no effect if its adapter is gone, or on a pseudo-terminal.
    """
    with suppress(OSError):
        if not is_pseudo(os.fstat(descriptor).st_rdev):
            fcntl.ioctl(descriptor, termios.TIOCEXCL)
    try:
        yield
    finally:
        with suppress(OSError):
            fcntl.ioctl(descriptor, termios.TIOCNXCL)


def _processes() -> list[int]:
    """Return all other processes of the machine, the highest numbers first."""
    found = {int(name) for name in os.listdir("/proc") if name.isdigit()}  # noqa: PTH208 - names
    return sorted(found - {os.getpid()}, reverse=True)


def _target(entry: str) -> int | None:
    """Return the device number behind a process's descriptor; None: it is no device."""
    try:
        # The link's text first: accessing the file behind it can hang with the file's server.
        if not os.readlink(entry).startswith("/dev/"):  # noqa: PTH115
            return None
        found = os.stat(entry)  # noqa: PTH116
    except OSError:
        return None
    return found.st_rdev if stat.S_ISCHR(found.st_mode) else None
