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

from haptic_wall.controller.cli.options import Command, writing
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.files import would_be_lost

_RUNS = Path("runs")


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
        raise UserError("found standard output", field=option, given="-", wanted="a file's name")
    with writing(option, path):
        if path.is_dir():
            raise UserError(f"{path} is a folder", field=option, advice="name a file")
        if make:
            path.parent.mkdir(parents=True, exist_ok=True)
        _refuse_loss(option, path, force=force)
        if try_it and (path.is_file() or not path.exists()):  # a device is everybody's
            tempfile.TemporaryFile(dir=Path(os.path.realpath(path)).parent).close()


def take_folder(option: str, folder: Path, names: Iterable[str], *, force: bool) -> None:
    """Check that files can be written there without loss, and lock the folder until the end.

    Args:
        option: Option that names it.
        folder: Made if necessary.
        names: Names of the files.
        force: Replace any files.

    Raises:
        UserError: It is no folder, or not writable, or a file is there, or another command is
            writing there.
    """
    with writing(option, folder):
        if folder.exists() and not folder.is_dir():
            raise UserError("found a file, wanted a folder", field=option, given=folder)
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
        for name in names:
            if (folder / name).is_dir():
                raise UserError(f"{folder / name} is a folder", field=option, wanted="a file there")
            _refuse_loss(option, folder / name, force=force)
        held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        _at_the_end(lambda: os.close(held))
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(
                f"another command is writing in {folder}",
                field=option,
                advice="wait for its end, or name another place",
            ) from None


def new_stem(option: str, what: str, suffix: str = "") -> Path:
    """Return a new name in ./runs/, kept from other commands by an empty file or folder.

    Args:
        option: Option that would name another place.
        what: End of the name, after date and time.
        suffix: Of the file, which is removed at the end if it is still empty; empty: a folder.

    Raises:
        UserError: The folder ./runs/ cannot be written.
    """
    stem = _RUNS / f"{time.strftime('%Y%m%d-%H%M%S')}-{what}"
    with writing(option, _RUNS):
        _RUNS.mkdir(exist_ok=True)
        while True:
            place = Path(f"{stem}{suffix}")
            try:
                place.touch(exist_ok=False) if suffix else place.mkdir()
                break
            except FileExistsError:  # second run within a second
                stem = stem.with_name(stem.name + "+")

    def remove() -> None:
        with suppress(OSError):
            if not suffix:
                place.rmdir()
            elif not place.stat().st_size:
                place.unlink()

    _at_the_end(remove)
    return stem


def _refuse_loss(option: str, path: Path, *, force: bool) -> None:
    if not force and would_be_lost(path):
        raise UserError(
            "found a file, which would be lost",
            field=option,
            given=path,
            advice="name another place, or give --force to replace it",
        )


def _at_the_end(close: Callable[[], None]) -> None:
    click.get_current_context().call_on_close(close)
