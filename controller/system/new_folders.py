"""Makes the folders of a command's files, and removes those that stay empty.

Commands share folders: one has made it, another is about to write there. Each locks it together
with the others; a command that cannot lock it alone does not remove it.
"""

from __future__ import annotations

import fcntl
import os
from contextlib import suppress
from pathlib import Path

_LOOK = os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC
_made: list[tuple[Path, os.stat_result]] = []
"""Folders that this process has made, the outer ones first"""
_kept: list[int] = []
"""Open folders that no other command may remove"""


def make(folder: Path) -> None:
    """Make a folder, with those above it, for ``remove_empty`` to remove.

    Raises:
        OSError: It cannot be made.
    """
    for each in reversed([folder, *(above for above in folder.parents if not above.exists())]):
        try:
            each.mkdir()
        except OSError:  # whichever the system tells first of a folder that is there
            if not each.is_dir():
                raise
        else:
            _made.append((each, each.stat()))


def make_and_keep(folder: Path) -> None:
    """Make a folder that no other command removes until this one calls ``remove_empty``.

    Raises:
        OSError: It cannot be made.
    """
    kept = False
    while not kept:
        make(folder)
        kept = _keep(folder)


def remove_empty() -> None:
    """Remove the folders that this process has made, where nothing is in them.

    A folder that another command keeps stays, and so does one that somebody has put in its place.
    """
    while _kept:
        os.close(_kept.pop())
    while _made:
        folder, made = _made.pop()
        with suppress(OSError):
            there = os.open(folder, _LOOK | os.O_NOFOLLOW)
            try:
                fcntl.flock(there, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if os.path.samestat(os.fstat(there), made):
                    folder.rmdir()
            finally:
                os.close(there)


def _keep(folder: Path) -> bool:
    """Lock a folder together with other commands; False: one of them has just removed it."""
    try:
        there = os.open(folder, _LOOK)
    except FileNotFoundError:
        return False
    except OSError:  # without permission to look into it
        return True
    with suppress(OSError):  # a file system without locks, or somebody has locked it alone
        fcntl.flock(there, fcntl.LOCK_SH | fcntl.LOCK_NB)
    _kept.append(there)
    try:
        return os.path.samestat(os.fstat(there), folder.stat())
    except FileNotFoundError:
        return False
