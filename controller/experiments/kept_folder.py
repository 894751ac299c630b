"""A folder of stored results: identified by their settings, never partially written."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from pydantic import ValidationError

from haptic_wall import __version__
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.files import make_folder

MOST_BYTES = 2**24
"""Largest size of a stored table, report or picture"""


def fingerprint(described: Mapping[str, Any]) -> str:
    """Return a text that differs when any description differs, or the program's version.

    Args:
        described: Everything that the results depend on, as JSON can hold it.
    """
    text = json.dumps({"program": __version__, **described}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def refused(folder: Path, found: str, advice: str, wanted: str = "") -> UserError:
    """Return the error about a folder that cannot be used.

    Args:
        folder: The folder.
        found: What was found in it.
        advice: Remedy.
        wanted: In place of what was found.
    """
    return UserError(found, field="--out", given=folder, wanted=wanted, advice=advice)


def made(folder: Path, logs: str) -> None:
    """Make the folder, and the one for logs in it.

    Raises:
        UserError: It cannot be made, or written to.
    """
    try:
        make_folder(folder / logs)
    except OSError as error:
        what = f"the folder cannot be made ({error.strerror})"
        raise refused(folder, what, "name another place") from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise refused(folder, "found a folder without write permission", "name another place")


def kept_bytes(path: Path, again: str) -> bytes:
    """Read a file of the folder.

    The folder may come from another user: a link could lead to any file; a device or a pipe never
    ends.

    Args:
        path: Path of the file; links are not followed.
        again: Advice for an unusable file, for the message.

    Raises:
        UserError: It is no plain file of up to ``MOST_BYTES``, or cannot be read.
    """

    def unusable(found: str) -> UserError:
        wanted = f"a plain file of up to {MOST_BYTES >> 20} MB"
        return refused(path.parent, f"{path.name}: found {found}", again, wanted)

    try:
        with open(path, "rb", opener=plainly) as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise unusable("a device or a pipe")
            content = file.read(MOST_BYTES + 1)
    except OSError as error:
        if isinstance(error, IsADirectoryError):
            raise unusable("a folder") from None
        link = error.errno == errno.ELOOP
        raise unusable("a link" if link else str(error.strerror or error)) from None
    if len(content) > MOST_BYTES:
        raise unusable("a longer one")
    return content


def plainly(path: str, flags: int) -> int:
    """Open a file without following links or waiting for a pipe."""
    return os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)


def first_wrong(error: ValidationError) -> str:
    """Describe the first error of a file: field and reason."""
    wrong = error.errors(include_url=False, include_input=False)[0]
    where = ".".join(map(str, wrong["loc"]))
    return f"{where}: {wrong['msg']}" if where else wrong["msg"]


def without_link(path: Path) -> Path:
    """Remove a symbolic link at a path, whose target may be foreign; return the path.

    Raises:
        OSError: It cannot be removed.
    """
    if path.is_symlink():
        path.unlink()
    return path


@contextmanager
def replaced(path: Path) -> Iterator[IO[str]]:
    """Rewrite a file; readers find the old or the new content, never a part.

    Raises:
        OSError: It cannot be written; the old one stays.
    """
    part = path.with_name(f"{path.name}.part")
    part.unlink(missing_ok=True)
    try:
        with part.open("x", newline="", encoding="utf-8") as stream:
            yield stream
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
