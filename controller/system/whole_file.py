"""Files that are there whole or not at all: written under another name, then put in place."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from haptic_wall.controller.system.file_kinds import Kind, may_be_replaced
from haptic_wall.controller.system.signals import interrupting

_NAME = 40
"""Characters of a file's name that its other name shows: a name has 255 bytes at most"""


class Beside:
    """Another name beside a file's, until there is something to replace that file with.

    A device or a pipe (/dev/stdout, ``>(gzip)``) is written as it is.

    Args:
        path: Where the file goes; what a link points to is replaced, not the link.
        kind: What it is.
        force: Replace whatever is there.
        writer: Number of the process that the other name names; None: this one's.

    Attributes:
        part: Where to write until it is placed.
    """

    def __init__(
        self, path: Path, kind: Kind, *, force: bool = False, writer: int | None = None
    ) -> None:
        # First: a pipe has no name to resolve to, and others write to what /dev/stdout is, too.
        self._as_it_is = path.exists() and (not path.is_file() or path.is_relative_to("/dev"))
        self._kind = kind
        self._force = force
        if self._as_it_is:
            self._path = self.part = path
            return
        self._path = Path(os.path.realpath(path))  # of links in a circle too
        pid = os.getpid() if writer is None else writer
        self.part = self._path.with_name(f".{path.name[:_NAME]}.{pid}.part")

    def begin(self) -> None:
        """Make the file to write to, anew: a link that somebody has put there is not followed.

        Raises:
            OSError: It cannot be made.
        """
        if not self._as_it_is:
            self.part.unlink(missing_ok=True)
            os.close(os.open(self.part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))

    def place(self) -> None:
        """Put what was written in its place.

        Raises:
            FileExistsError: A file that is none of this program's is there.
            OSError: It cannot be put there.
        """
        if self._as_it_is:
            return
        if not self._force and not may_be_replaced(self._path, self._kind):
            why = f"found a file that is not {self._kind.name}"
            raise FileExistsError(errno.EEXIST, why, str(self._path))
        self.part.replace(self._path)

    def discard(self) -> None:
        """Remove what was written, if it was not placed."""
        if not self._as_it_is:
            self.part.unlink(missing_ok=True)


@contextmanager
def whole(path: Path, kind: Kind, *, force: bool = False) -> Iterator[Path]:
    """Where to write in place of ``path``; it is moved there when all went well, else removed.

    Ctrl-C, SIGTERM and SIGHUP interrupt whoever writes: a terminal that is closed and a machine
    that shuts down leave no half file. What is ignored, by nohup for instance, stays so.

    Args:
        path: Where the file goes, see ``Beside``.
        kind: What it is.
        force: Replace whatever is there.

    Raises:
        FileExistsError: A file that is none of this program's is there.
        OSError: It cannot be put in place.
        KeyboardInterrupt: It was interrupted.
    """
    beside = Beside(path, kind, force=force)
    try:
        with interrupting():
            beside.begin()
            yield beside.part
            beside.place()
    finally:
        beside.discard()


def remove_leftovers(path: Path) -> None:
    """Remove what commands that were killed while they wrote a file have left beside it.

    Args:
        path: The file, which nobody else writes now.

    Raises:
        OSError: Its folder cannot be read.
    """
    place = Path(os.path.realpath(path))
    name = re.compile(re.escape(f".{path.name[:_NAME]}.") + r"(\d{1,9})\.part")
    for entry in place.parent.iterdir():
        found = name.fullmatch(entry.name)
        if found is not None and not _is_alive(int(found[1])):
            with suppress(OSError):
                entry.unlink()


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
