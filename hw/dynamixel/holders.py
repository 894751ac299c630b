"""Which processes have a device open, as Linux tells it in ``/proc``; nothing is opened for it."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Final

_PTMX: Final = os.makedev(5, 2)
"""The device behind the controlling end of every pseudo-terminal."""
_PTS_MAJORS: Final = range(136, 144)
"""Of the devices at the other ends."""
_DRIVERS: Final = Path("/proc/tty/drivers")


def holders(device: int) -> Iterator[tuple[int, str]]:
    """Other processes that have a device open, as far as this user may see: pid and program.

    Args:
        device: The device's number (``st_rdev``).
    """
    for pid in processes():
        if (program := holder(pid, device)) is not None:
            yield pid, program


def processes() -> list[int]:
    """All other processes of the machine, the youngest numbers first."""
    found = {int(name) for name in os.listdir("/proc") if name.isdigit()}  # noqa: PTH208 - names
    return sorted(found - {os.getpid()}, reverse=True)


def holder(pid: int, device: int) -> str | None:
    """The program of a process that has a device open; None: it has not, or nobody may see it.

    On a pseudo-terminal a process that also holds a controlling end is left out: it is the
    emulator on the far side.

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
    except OSError:  # it ended, or is somebody else's
        pass
    return None


def is_pseudo(device: int) -> bool:
    """Whether a device is the end of a pseudo-terminal that programs open."""
    return os.major(device) in _PTS_MAJORS


def is_terminal(device: int) -> bool:
    """Whether a device is a terminal; others may have any number of users.

    Read from the kernel's list: to open a port disturbs whoever uses it.
    """
    try:
        rows = [line.split() for line in _DRIVERS.read_text().splitlines()]
    except OSError:  # nobody knows: what programs look for as a port is one
        return True
    major, minor = os.major(device), os.minor(device)
    for *_, number, minors, _kind in rows:
        first, _, last = minors.partition("-")
        if int(number) == major and int(first) <= minor <= int(last or first):
            return True
    return False


def _target(entry: str) -> int | None:
    """The device number behind a descriptor of some process; None where it is no device."""
    try:
        # The link's text first: a look at a file behind it can hang with the file's server.
        if not os.readlink(entry).startswith("/dev/"):  # noqa: PTH115
            return None
        found = os.stat(entry)  # noqa: PTH116
    except OSError:
        return None
    return found.st_rdev if stat.S_ISCHR(found.st_mode) else None
