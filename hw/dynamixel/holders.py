"""Finds the processes that have a device open, from ``/proc``; does not open the device."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Final

_PTMX: Final = os.makedev(5, 2)
"""The device behind the controlling end of every pseudo-terminal."""
_PTS_MAJORS: Final = range(136, 144)
"""Major numbers of the devices at the other ends."""
_DRIVERS: Final = Path("/proc/tty/drivers")


def holders(device: int) -> Iterator[tuple[int, str]]:
    """Yield other processes that have a device open, as far as this user may see: pid and program.

    Args:
        device: The device's number (``st_rdev``).
    """
    for pid in processes():
        if (program := holder(pid, device)) is not None:
            yield pid, program


def processes() -> list[int]:
    """Return all other processes of the machine, the highest numbers first."""
    found = {int(name) for name in os.listdir("/proc") if name.isdigit()}  # noqa: PTH208 - names
    return sorted(found - {os.getpid()}, reverse=True)


def holder(pid: int, device: int) -> str | None:
    """Return the program of a process that has a device open; None: it has not, or is not visible.

    A process that also has the controlling end of the pseudo-terminal open is ignored: it is the
    emulator at the other end.

    Args:
        pid: The process.
        device: The device's number (``st_rdev``).
    """
    pseudo = is_pseudo(device)
    holds = far_side = False
    folder = f"/proc/{pid}/fd"
    try:
        for entry in os.listdir(folder):  # noqa: PTH208 - paths as objects take twice as long
            target = _target(f"{folder}/{entry}")
            holds |= target == device
            far_side |= pseudo and target == _PTMX
        if holds and not far_side:
            return Path(f"/proc/{pid}/comm").read_text().strip()
    except OSError:  # it ended, or belongs to another user
        pass
    return None


def is_pseudo(device: int) -> bool:
    """Whether a device is the client end of a pseudo-terminal."""
    return os.major(device) in _PTS_MAJORS


def is_terminal(device: int) -> bool:
    """Whether a device is a terminal; other devices may have any number of users.

    It reads the kernel's list: opening a port disturbs its user.
    """
    try:
        rows = [line.split() for line in _DRIVERS.read_text().splitlines()]
    except OSError:  # unknown: assume that a configured port is one
        return True
    major, minor = os.major(device), os.minor(device)
    for *_, number, minors, _kind in rows:
        first, _, last = minors.partition("-")
        if int(number) == major and int(first) <= minor <= int(last or first):
            return True
    return False


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
