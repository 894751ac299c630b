"""Keeps other programs off a port in use: prevents their access if possible, else finds them.

A second program on the bus garbles frames and takes replies away. Three measures are combined,
because none of them suffices alone:

1. **Exclusive use** (TIOCEXCL). The kernel refuses further openings, but not those of root.
   It is released at the end; where this process is killed, the last close of the port does it.
   A pseudo-terminal would stay refused, because its users do not close it last: there the measure
   is omitted.
2. **Detection of openings** (inotify), also by root, without the name of the program.
3. **Search of open files** (``/proc``), a few processes at each look, so that all processes visible
   to this user are searched within a second, and sooner after an opening.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import struct
import termios
from contextlib import suppress
from pathlib import Path
from typing import Final

from haptic_wall.hw.dynamixel.holders import holder, holders, is_pseudo, processes

LOOKS: Final = 24
"""Number of looks to search all processes: a second at one look per 40 ms, as with the slowest
loop, and usually half of that"""
URGENT: Final = 4
"""The same after the port was opened"""
_PATIENCE: Final = 10
"""Number of looks that an opening by an invisible program may last"""
_IN_CLOSE: Final = 0x08 | 0x10
_IN_OPEN: Final = 0x20
_EVENT: Final = struct.Struct("=iIII")


class PortUsers:
    """Reserves a port for this process and its children, and finds other users.

    Args:
        descriptor: The open port; it stays open.

    Attributes:
        brief: Whether another program opened and closed the port without being identified.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._device = os.fstat(descriptor).st_rdev
        self._path = str(_link(descriptor).readlink())
        self._left: list[int] = []
        """Processes that this round has not searched yet"""
        self._at_once = 1
        self._opened = 0
        """Openings by others without a close"""
        self._unseen = 0
        """Looks since then"""
        self.brief = False
        if not is_pseudo(self._device):
            exclusive(descriptor, True)
        self._events = _openings(descriptor)

    def look(self) -> str:
        """Search some processes; return a text about other users of the port, or an empty one."""
        if self._opening_noticed():
            self._begin(URGENT)
        elif not self._left:
            self._begin(LOOKS)
        for _ in range(min(self._at_once, len(self._left))):
            pid = self._left.pop(0)
            program = holder(pid, self._device)
            if program is not None and not _descends(pid, os.getpid()):
                return self._text(pid, program)
        self._unseen = self._unseen + 1 if self._opened else 0
        return self._unknown() if self._unseen > _PATIENCE else ""

    def look_everywhere(self) -> str:
        """Search all processes at once; see ``look``."""
        for pid, program in holders(self._device):
            if not _descends(pid, os.getpid()):
                return self._text(pid, program)
        self._opening_noticed()
        return self._unknown() if self._opened else ""

    def close(self) -> None:
        """Release the port for others."""
        exclusive(self._descriptor, False)
        if self._events >= 0:
            os.close(self._events)
            self._events = -1

    def _text(self, pid: int, program: str) -> str:
        return f"{program} (pid {pid}) has opened {self._path}"

    def _unknown(self) -> str:
        return f"a program of another user has opened {self._path}"

    def _begin(self, looks: int) -> None:
        self._left = processes()
        self._at_once = -(-len(self._left) // looks)

    def _opening_noticed(self) -> bool:
        """Read the events; return whether the port was opened since the last look."""
        if self._events < 0:
            return False
        try:
            data = os.read(self._events, 4096)
        except BlockingIOError:
            return False
        new = False
        at = 0
        while at < len(data):
            _, mask, _, length = _EVENT.unpack_from(data, at)
            at += _EVENT.size + length
            if mask & _IN_OPEN:
                self._opened += 1
                new = True
            elif mask & _IN_CLOSE and self._opened:
                self._opened -= 1
                self.brief |= not self._opened
        return new


def exclusive(descriptor: int, wanted: bool) -> None:
    """Make the kernel refuse further openings of a port (except by root), or allow them again.

    Args:
        descriptor: The open port; no effect if its adapter is gone.
        wanted: Whether further openings are to be refused.
    """
    with suppress(OSError):
        fcntl.ioctl(descriptor, termios.TIOCEXCL if wanted else termios.TIOCNXCL)


def _link(descriptor: int) -> Path:
    return Path(f"/proc/self/fd/{descriptor}")


def _openings(descriptor: int) -> int:
    """Return a descriptor that reports openings and closings of a port; -1: not supported."""
    library = ctypes.CDLL(None)
    events = int(library.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC))
    if events < 0:
        return -1
    path = os.fsencode(_link(descriptor))  # the device itself, whatever its name
    if library.inotify_add_watch(events, path, _IN_OPEN | _IN_CLOSE) < 0:
        os.close(events)
        return -1
    return events


def _descends(pid: int, ancestor: int) -> bool:
    """Whether a process is a descendant of another."""
    while pid > 1:
        try:
            stat = Path(f"/proc/{pid}/stat").read_bytes()
            pid = int(stat.rpartition(b")")[2].split()[1])
        except (OSError, ValueError, IndexError):
            return False  # it has ended
        if pid == ancestor:
            return True
    return False
