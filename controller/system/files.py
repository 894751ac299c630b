"""Reads files that are regular, and writes files that are complete or absent."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from haptic_wall.controller.system.signals import interrupting

_NAME = 40
"""Characters of a file's name in its temporary name: a name has 255 bytes at most"""
_FLAGS = (
    os.O_RDONLY
    | getattr(os, "O_CLOEXEC", 0)
    | getattr(os, "O_NOCTTY", 0)
    | getattr(os, "O_NONBLOCK", 0)  # a pipe that has replaced the file must not block
)
_KINDS = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def opened(path: Path) -> BinaryIO:
    """Open a regular file for reading: any other kind may never end.

    Raises:
        OSError: It cannot be opened, or is a folder, a pipe, a device or a socket, which its
            ``strerror`` says.
    """
    try:
        _refuse_others(path.stat().st_mode, path)  # first: opening a device may act
        descriptor = os.open(path, _FLAGS)
    except ValueError:
        raise OSError(errno.EINVAL, "no file can have such a name", str(path)) from None
    try:
        _refuse_others(os.fstat(descriptor).st_mode, path)
        return os.fdopen(descriptor, "rb")
    except OSError:
        os.close(descriptor)
        raise


def _refuse_others(mode: int, path: Path) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    for is_kind, name in _KINDS:
        if is_kind(mode):
            raise OSError(errno.EINVAL, f"it is {name}, not a file", str(path))


def content(path: Path, most: int) -> bytes:
    """Return the content of a regular file.

    Args:
        path: The file.
        most: Largest size [bytes].

    Raises:
        OSError: As ``opened``; or the file is larger.
    """
    with opened(path) as file:
        held = file.read(most + 1)
    if len(held) > most:
        raise OSError(errno.EFBIG, f"it has more than {most} bytes", str(path))
    return held


def is_full(error: OSError) -> bool:
    """Whether an error means that more room on the disk would help."""
    return error.errno in (errno.ENOSPC, errno.EDQUOT)


def would_be_lost(path: Path) -> bool:
    """Whether a file is there that a new one would replace; an empty one does not count."""
    with suppress(OSError):
        found = path.stat()
        return stat.S_ISREG(found.st_mode) and found.st_size > 0
    return False


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Yield a path to write to in place of ``path``; on success it is moved there, else removed.

    A link's target is replaced, not the link. A device or a pipe (/dev/stdout, ``>(gzip)``) is
    written directly. Ctrl-C, SIGTERM and SIGHUP interrupt the writer, so that a closed terminal and
    a shutdown leave no partial file. Ignored signals (nohup) stay ignored.

    Raises:
        OSError: It cannot be put in place.
        KeyboardInterrupt: It was interrupted.
    """
    # Checked first: a pipe's name cannot be resolved, and /dev/stdout may have other writers.
    if path.exists() and (not path.is_file() or path.is_relative_to("/dev")):
        with interrupting():
            yield path
        return
    place = Path(os.path.realpath(path))  # also resolves circular links
    part = place.with_name(f".{path.name[:_NAME]}.{os.getpid()}.part")
    try:
        with interrupting():
            part.unlink(missing_ok=True)  # never follow a link that another user has put there
            os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
            yield part
            part.replace(place)
    finally:
        part.unlink(missing_ok=True)
