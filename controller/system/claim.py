"""Claims files and folders, so that a second command cannot write to the same place.

A claim is the name of a socket in the kernel. It works on every file system, leaves no file behind,
and ends with its process, however that ends. The writer of a log also locks the file: this covers a
recorder that has outlived its run, and one in another container.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

_BUSY = "another run writes it"


class ClaimedError(OSError):
    """Another command is writing to the place."""


@contextmanager
def claimed(path: Path, *, follow: bool = True) -> Iterator[None]:
    """Keep other commands of this program on this machine from writing a file or folder.

    The same file under another name (a link, a relative path) is the same place. A device is never
    claimed. On systems other than Linux nothing is claimed.

    Args:
        path: A file or folder, existing or not; its folder must exist.
        follow: Claim the target of a link; else the link itself.

    Raises:
        ClaimedError: Another command has claimed it.
        OSError: It cannot be accessed.
    """
    with ExitStack() as held:
        if sys.platform == "linux":
            for name in _names(path) if follow else [_name(path)]:
                if (socket_held := _held(name)) is not None:
                    held.enter_context(socket_held)
        if follow and path.is_file() and _is_locked(path):
            raise ClaimedError(errno.EBUSY, _BUSY)
        yield


def _names(path: Path) -> list[str]:
    """Return a place's identifiers: folder and name, and its identity where it exists."""
    place = Path(os.path.realpath(path))  # also resolves circular links
    names = [_name(place)]
    if place.is_file() or place.is_dir():
        itself = place.stat()
        names.append(f"{itself.st_dev}/{itself.st_ino}")
    elif place.exists():
        return []
    return names


def _name(place: Path) -> str:
    folder = place.parent.stat()
    return f"{folder.st_dev}/{folder.st_ino}/{place.name}"


def _held(name: str) -> socket.socket | None:
    """Return a socket of that name; None: this sandbox has no sockets, so no process has one.

    Raises:
        ClaimedError: Another process has it.
    """
    digest = hashlib.sha256(name.encode(errors="surrogateescape")).hexdigest()
    try:
        held = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    except OSError:
        return None
    try:
        held.bind(f"\0haptic-wall/{digest}")
    except OSError as error:
        held.close()
        if error.errno == errno.EADDRINUSE:
            raise ClaimedError(errno.EBUSY, _BUSY) from None
        return None
    return held


def _is_locked(file: Path) -> bool:
    with suppress(OSError), file.open("rb") as opened:
        try:
            fcntl.flock(opened, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False
