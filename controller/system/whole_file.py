"""Writes files that are complete or absent: under a temporary name, then put in place."""

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
"""Characters of a file's name in its temporary name: a name has 255 bytes at most"""


class Beside:
    """A temporary name beside a file's, until its content may replace that file.

    A device or a pipe (/dev/stdout, ``>(gzip)``) is written directly.

    Args:
        path: Destination of the file; a link's target is replaced, not the link.
        kind: Kind of the file.
        force: Replace any file.
        writer: Process number in the temporary name; None: this process's.

    Attributes:
        part: Where to write until it is placed.
    """

    def __init__(
        self, path: Path, kind: Kind, *, force: bool = False, writer: int | None = None
    ) -> None:
        # Checked first: a pipe's name cannot be resolved, and /dev/stdout may have other writers.
        self._as_it_is = path.exists() and (not path.is_file() or path.is_relative_to("/dev"))
        self._kind = kind
        self._force = force
        if self._as_it_is:
            self._path = self.part = path
            return
        self._path = Path(os.path.realpath(path))  # also resolves circular links
        pid = os.getpid() if writer is None else writer
        self.part = self._path.with_name(f".{path.name[:_NAME]}.{pid}.part")

    def begin(self) -> None:
        """Create the file to write to; does not follow a link that another user has put there.

        Raises:
            OSError: It cannot be made.
        """
        if not self._as_it_is:
            self.part.unlink(missing_ok=True)
            os.close(os.open(self.part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))

    def place(self) -> None:
        """Move the written file to its destination.

        Raises:
            FileExistsError: The destination has a file that this program did not write.
            OSError: It cannot be put there.
        """
        if self._as_it_is:
            return
        if not self._force and not may_be_replaced(self._path, self._kind):
            why = f"found a file that is not {self._kind.name}"
            raise FileExistsError(errno.EEXIST, why, str(self._path))
        self.part.replace(self._path)

    def discard(self) -> None:
        """Remove the written file, if it was not placed."""
        if not self._as_it_is:
            self.part.unlink(missing_ok=True)


@contextmanager
def whole(path: Path, kind: Kind, *, force: bool = False) -> Iterator[Path]:
    """Yield a path to write to in place of ``path``; on success it is moved there, else removed.

    Ctrl-C, SIGTERM and SIGHUP interrupt the writer, so that a closed terminal and a shutdown leave
    no partial file. Ignored signals (nohup) stay ignored.

    Args:
        path: Destination of the file, see ``Beside``.
        kind: Kind of the file.
        force: Replace any file.

    Raises:
        FileExistsError: The destination has a file that this program did not write.
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
    """Remove temporary files that killed commands have left beside a file.

    Args:
        path: The file; it has no other writer now.

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
