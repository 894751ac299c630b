"""The socket of a running wall: its path, its permissions, and the list of runs that have one.

It lies beside the log, and is open to its owner alone. Runs are found by their processes, and each
must listen at its socket: neither the arguments of another process nor a socket left behind by a
killed run is taken for one.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from haptic_wall.controller.errors import UserError

MODULE: Final = "haptic_wall.controller.live.door"
"""The process that listens; the socket's path is its argument"""
SUFFIX: Final = ".sock"
"""After the log's name"""
MOST_BYTES: Final = 1 << 16
"""Longest request, and longest answer"""
OVER: Final = "the run is over"
NOT_MADE: Final = 3
"""Exit status of a change that was not made"""
_CREDENTIALS: Final = struct.Struct("3i")


@dataclass(frozen=True, slots=True)
class AliveRun:
    """A run that takes changes."""

    socket: Path
    pid: int
    """Process id of the process that listens"""

    @property
    def log(self) -> Path:
        """Return the path of its log."""
        return self.socket.with_name(self.socket.name.removesuffix(SUFFIX))

    @property
    def is_here(self) -> bool:
        """Whether its log lies in the current folder, or in one below."""
        return Path.cwd() in Path(os.path.realpath(self.log)).parents


def socket_of(log: Path) -> Path:
    """Return the path of the socket of a run with this log."""
    place = Path(os.path.abspath(log))  # noqa: PTH100 - a link stays the name that the user knows
    return place.with_name(place.name + SUFFIX)


@contextlib.contextmanager
def _name_of(path: Path) -> Iterator[str]:
    """Yield a short name of a path: the kernel takes 107 bytes."""
    folder = os.open(path.parent, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        yield f"/proc/self/fd/{folder}/{path.name}"
    finally:
        os.close(folder)


def listening(path: Path) -> socket.socket:
    """Return a socket that listens at a path; no other user may connect.

    A socket that a killed run has left there is replaced.

    Raises:
        OSError: It cannot be made there, or another run listens.
    """
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    before = os.umask(0o177)  # from the first instant on
    try:
        with _name_of(path) as name:
            try:
                listener.bind(name)
            except OSError as error:
                if error.errno != errno.EADDRINUSE or not path.is_socket() or _is_heard(path):
                    raise
                path.unlink()
                listener.bind(name)
        listener.listen(64)
    except BaseException:
        listener.close()
        raise
    finally:
        os.umask(before)
    return listener


def remove_if_dead(path: Path) -> None:
    """Remove a socket at a path where nobody listens any more; leave anything else there."""
    with contextlib.suppress(OSError):
        if path.is_socket() and not _is_heard(path):
            path.unlink()


def _is_heard(path: Path) -> bool:
    return _listener(path) is not None


def _listener(path: Path) -> tuple[int, int] | None:
    """Return process and user that listen at a path, by the kernel's word; None: none do."""
    try:
        with connected(path) as connection:
            found = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    except ConnectionRefusedError:
        return None
    pid, uid, _ = _CREDENTIALS.unpack(found)
    return pid, uid


def connected(path: Path) -> socket.socket:
    """Return a connection to a running wall.

    Raises:
        OSError: None listens there.
    """
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        with _name_of(path) as name:
            connection.connect(name)
    except BaseException:
        connection.close()
        raise
    return connection


def alive() -> list[AliveRun]:
    """Return this user's runs that take changes, the newest last."""
    found = []
    for each in Path("/proc").iterdir():
        if not each.name.isdigit():
            continue
        with contextlib.suppress(OSError, ValueError, IndexError):
            words = (each / "cmdline").read_bytes().split(b"\0")
            path = Path(os.fsdecode(words[words.index(MODULE.encode()) + 1]))
            if _listener(path) == (int(each.name), os.getuid()):
                found.append(AliveRun(path, int(each.name)))
    return sorted(found, key=lambda run: run.pid)


def chosen(asked: Path | None, runs: Sequence[AliveRun]) -> AliveRun:
    """Return the run that a command means.

    Args:
        asked: The folder or the log of the run; None: the only one in the current folder and those
            below, else the only one.
        runs: Those alive.

    Raises:
        UserError: There is none, or several.
    """
    which = list(runs)
    if asked is not None:
        place = Path(os.path.realpath(asked))
        for each in place.glob(f"*{SUFFIX}") if place.is_dir() else [socket_of(place)]:
            remove_if_dead(each)
        which = [
            run
            for run in runs
            if place in (Path(os.path.realpath(run.log)), Path(os.path.realpath(run.log.parent)))
        ]
    else:
        which = [run for run in runs if run.is_here] or which
    if len(which) == 1:
        return which[0]
    names = ", ".join(str(run.log) for run in which or runs)
    if which:
        raise UserError(
            f"found {len(which)} running walls: {names}",
            field="--run",
            wanted="one",
            advice="name the log of one of them",
        )
    raise UserError(
        "no wall is running" if asked is None else f"no wall is running in {asked}",
        field="--run",
        advice=f"name one of {names}" if runs else "start one with `haptic-wall run`",
    )
