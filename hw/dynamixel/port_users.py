"""Who else uses a port while a servo is driven on it: refused where possible, else noticed.

A second program on the bus garbles frames and takes replies away. Three things are done, since none
is enough:

1. **Exclusive use** (TIOCEXCL). The kernel refuses further openings, but not those of root.
   It is released at the end; where this process is killed, the last close of the port does it.
   A pseudo-terminal is not closed last by its users, so it would stay refused: none is taken there.
2. **Openings are noticed** (inotify), those of root too, but not by whom.
3. **Open files are looked up** (``/proc``), a few processes at each look, so that all that this
   user may see are through within a second, and sooner after an opening.
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
"""Looks in which all processes are through: in a second where one comes every 40 ms, as with the
slowest loop, and in half of that usually"""
URGENT: Final = 4
"""The same when somebody has just opened the port"""
_PATIENCE: Final = 10
"""Looks that an opening by nobody to be seen may last"""
_IN_CLOSE: Final = 0x08 | 0x10
_IN_OPEN: Final = 0x20
_EVENT: Final = struct.Struct("=iIII")


class PortUsers:
    """Keeps a port to this process and its children, and finds out who uses it all the same.

    Args:
        descriptor: The open port; it stays open.

    Attributes:
        brief: Somebody opened the port and closed it again, without being seen.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._device = os.fstat(descriptor).st_rdev
        self._path = str(_link(descriptor).readlink())
        self._left: list[int] = []
        """Processes that this round has still to look at"""
        self._at_once = 1
        self._opened = 0
        """Openings by others that were not closed again"""
        self._unseen = 0
        """Looks since then"""
        self.brief = False
        if not is_pseudo(self._device):
            exclusive(descriptor, True)
        self._events = _openings(descriptor)

    def look(self) -> str:
        """Look a little; who else has the port open, for people. Empty: nobody was seen."""
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
        """Look at all processes at once; see ``look``."""
        for pid, program in holders(self._device):
            if not _descends(pid, os.getpid()):
                return self._text(pid, program)
        self._opening_noticed()
        return self._unknown() if self._opened else ""

    def close(self) -> None:
        """Let others use the port again."""
        exclusive(self._descriptor, False)
        if self._events >= 0:
            os.close(self._events)
            self._events = -1

    def _text(self, pid: int, program: str) -> str:
        return f"{program} (pid {pid}) has opened {self._path}"

    def _unknown(self) -> str:
        return f"a program that this user may not see has opened {self._path}"

    def _begin(self, looks: int) -> None:
        self._left = processes()
        self._at_once = -(-len(self._left) // looks)

    def _opening_noticed(self) -> bool:
        """Read what has happened; whether somebody has opened the port since the last look."""
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
    """Have the kernel refuse further openings of a port by anybody but root, or no longer.

    Args:
        descriptor: The open port; nothing happens where its adapter is gone.
        wanted: Whether they are to be refused.
    """
    with suppress(OSError):
        fcntl.ioctl(descriptor, termios.TIOCEXCL if wanted else termios.TIOCNXCL)


def _link(descriptor: int) -> Path:
    return Path(f"/proc/self/fd/{descriptor}")


def _openings(descriptor: int) -> int:
    """A descriptor that tells who opens and closes a port; -1: this system has none."""
    library = ctypes.CDLL(None)
    events = int(library.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC))
    if events < 0:
        return -1
    path = os.fsencode(_link(descriptor))  # the very device, whatever its name
    if library.inotify_add_watch(events, path, _IN_OPEN | _IN_CLOSE) < 0:
        os.close(events)
        return -1
    return events


def _descends(pid: int, ancestor: int) -> bool:
    """Whether a process is a child of another, or a child's child."""
    while pid > 1:
        try:
            stat = Path(f"/proc/{pid}/stat").read_bytes()
            pid = int(stat.rpartition(b")")[2].split()[1])
        except (OSError, ValueError, IndexError):
            return False  # it has ended
        if pid == ancestor:
            return True
    return False
