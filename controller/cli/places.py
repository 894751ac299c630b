"""Refuses to write over a file, before any work is done, unless ``--force`` is given."""

from __future__ import annotations

import fcntl
import os
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

import click

from haptic_wall.controller.cli import interrupt
from haptic_wall.controller.cli.options import Command, refuse_no_folder, refuse_same_file, writing
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.files import make_folder, remove_empty, would_be_lost

_RUNS = Path("runs")
_TAKEN = ("", ".hwlog", ".png")
"""Suffixes that may follow a new name in an existing file"""


def force_option(command: Command) -> Command:
    """Add ``--force``, passed to the command as ``force``."""
    return click.option("--force", is_flag=True, help="Also replace existing files.")(command)


def take_file(
    option: str, path: Path, *, force: bool, make: bool = False, try_it: bool = True
) -> None:
    """Check that a file can be written there without loss.

    Args:
        option: Option that names it.
        path: Path of the file.
        force: Replace any file.
        make: Make its folder if necessary.
        try_it: Refuse a folder without write permission.

    Raises:
        UserError: A folder or a file is there, or it cannot be written.
    """
    if str(path) == "-":
        raise UserError(
            "found standard output",
            field=option,
            given="-",
            wanted="a file: this format is not written in sequence",
            advice="name one",
        )
    refuse_same_file({option: path})  # as one that cannot be looked at
    if path.is_dir():
        raise UserError(f"{path} is a folder", field=option, advice="name a file")
    if make:
        _make(option, path.parent)
    if path.exists() and not path.is_file():
        return  # a device, which is everybody's
    _refuse_loss(option, path, force=force)
    if try_it:
        with writing(option, path):
            tempfile.TemporaryFile(dir=Path(os.path.realpath(path)).parent).close()


def take_folder(option: str, folder: Path, names: Iterable[str], *, force: bool) -> None:
    """Check that files can be written there without loss, and lock the folder until the end.

    Args:
        option: Option that names it.
        folder: Made if necessary, and removed if it is empty at the end.
        names: Names of the files.
        force: Replace any files.

    Raises:
        UserError: It is no folder, or not writable, or a file is there, or another command is
            writing there.
    """
    refuse_no_folder(option, folder)
    _make(option, folder)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UserError(
            "found a folder without write permission",
            field=option,
            given=folder,
            advice="name another place",
        )
    for name in names:
        if (folder / name).is_dir():
            raise UserError(
                f"found a folder {name} in it",
                field=option,
                given=folder,
                wanted="a file or nothing",
                advice="name another place",
            )
        _refuse_loss(option, folder / name, force=force)
    with writing(option, folder):
        held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        _until_the_end(lambda: os.close(held))
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(
                f"another command is writing in {folder}",
                field=option,
                advice="wait for its end, or name another place",
            ) from None


def take_link(option: str, path: Path, *, force: bool) -> None:
    """Check that a link to a terminal can be made there.

    Args:
        option: Option that names it.
        path: Path of the link; one that a killed command has left leads nowhere.
        force: Replace any link.

    Raises:
        UserError: Something is there.
    """
    leads = path.is_symlink() and (path.exists() or path.readlink().parent != Path("/dev/pts"))
    if leads and not force:
        raise UserError(
            f"found a link to {path.readlink()}, which would be lost",
            field=option,
            given=path,
            advice="name another place, or give --force to replace it",
        )


def new_stem(option: str, what: str, suffix: str = "") -> Path:
    """Return a name in ./runs/ with which no existing name begins.

    An empty file of that name with ``suffix``, or a folder, keeps other commands from it; it is
    removed at the end if nothing is in it.

    Args:
        option: Option that would name another place.
        what: End of the name, after date and time.
        suffix: Of the file; empty: a folder.

    Raises:
        UserError: The folder ./runs/ cannot be made.
    """
    _make(option, _RUNS)
    stem = _RUNS / f"{time.strftime('%Y%m%d-%H%M%S')}-{what}"
    with writing(option, _RUNS):
        while not _reserved(stem, suffix):  # second run within a second
            stem = stem.with_name(stem.name + "+")
    return stem


def _reserved(stem: Path, suffix: str) -> bool:
    if any(os.path.lexists(f"{stem}{end}") for end in _TAKEN):
        return False
    place = Path(f"{stem}{suffix}")
    try:
        place.touch(exist_ok=False) if suffix else place.mkdir()
    except FileExistsError:
        return False

    def remove() -> None:
        with suppress(OSError):
            if not suffix:
                place.rmdir()
            elif not place.stat().st_size:
                place.unlink()

    _until_the_end(remove)
    return True


def _make(option: str, folder: Path) -> None:
    _until_the_end(remove_empty)
    try:
        make_folder(folder)
    except OSError as error:
        raise UserError(
            f"the folder {folder} cannot be made ({error.strerror})",
            field=option,
            advice="name another place",
        ) from error


def _refuse_loss(option: str, path: Path, *, force: bool) -> None:
    if not force and would_be_lost(path):
        raise UserError(
            "found a file, which would be lost",
            field=option,
            given=path,
            advice="name another place, or give --force to replace it",
        )


def _until_the_end(close: Callable[[], None]) -> None:
    click.get_current_context().call_on_close(close)


interrupt.do_first(remove_empty)
