"""Refuses to write over a file, before any work is done, unless ``--force`` is given."""

from __future__ import annotations

import fcntl
import os
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import click

from haptic_wall.controller.cli.options import Command, writing
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.files import would_be_lost

_RUNS = Path("runs")
_FORCE, _TAKEN = "haptic_wall.force", "haptic_wall.taken"
"""Keys of click's context: whether ``--force`` is given, and the files that are named so far"""


def _keep(context: click.Context, _option: click.Parameter, given: bool) -> None:
    context.meta[_FORCE] = given


force_option = click.option(
    "--force",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_keep,
    help="Also replace existing files, and earlier results.",
)
"""All of this module obeys it"""


def is_forced() -> bool:
    """Whether existing files and earlier results are replaced."""
    return bool(click.get_current_context().meta.get(_FORCE))


class FileToWrite(click.Path):
    """The path of a file that the command writes, checked as by ``take_file``.

    Args:
        picture: It is a PNG.
    """

    name = "file"

    def __init__(self, *, picture: bool = False) -> None:
        super().__init__(path_type=Path)
        self._picture = picture

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:  # noqa: ANN401 - click's signature
        """Return the path."""
        path = Path(str(super().convert(value, param, ctx)))
        assert param is not None
        option = param.opts[0] if isinstance(param, click.Option) else param.human_readable_name
        if self._picture:
            refuse_other_pictures(option, path)
        take_file(option, path)
        return path


def plot_option(text: str) -> Callable[[Command], Command]:
    """Add ``--plot`` and ``--force``; the picture's path is passed as ``plot``."""

    def decorated(command: Command) -> Command:
        command = force_option(command)
        return click.option("--plot", type=FileToWrite(picture=True), help=text)(command)

    return decorated


def refuse_other_pictures(option: str, path: Path) -> None:
    """Refuse a picture's name with another suffix than PNG's.

    Raises:
        UserError: It has another suffix.
    """
    if path.suffix.lower() not in ("", ".png"):
        raise UserError(
            f"found a name ending in {path.suffix}",
            field=option,
            given=path,
            wanted="one ending in .png: pictures are PNG",
        )


def take_file(option: str, path: Path, *, try_it: bool = True) -> None:
    """Check that a file can be written there without loss; make its folder.

    Args:
        option: Option that names it.
        path: Path of the file.
        try_it: Refuse a folder without write permission.

    Raises:
        UserError: A folder or a file is there, or it cannot be written, or another option has the
            same path.
    """
    if str(path) == "-":
        raise UserError("found standard output", field=option, given="-", wanted="a file's name")
    with writing(option, path):
        if path.is_dir():
            raise UserError(f"{path} is a folder", field=option, advice="name a file")
        _refuse_loss(option, path)
        _make(path.parent)
        if path.is_file() or not path.exists():  # a device is everybody's
            place = os.path.realpath(path)
            taken = click.get_current_context().meta.setdefault(_TAKEN, {})
            if (first := taken.setdefault(place, option)) != option:
                advice = "give each a file of its own"
                raise UserError(field=first, given=f"and {option} both name {path}", advice=advice)
            if try_it:
                tempfile.TemporaryFile(dir=Path(place).parent).close()


def take_folder(option: str, folder: Path, names: Iterable[str]) -> None:
    """Check that files can be written there without loss, and lock the folder until the end.

    Args:
        option: Option that names it.
        folder: Made if necessary.
        names: Names of the files.

    Raises:
        UserError: It is no folder, or not writable, or a file is there, or another command is
            writing there.
    """
    with writing(option, folder):
        if folder.exists() and not folder.is_dir():
            raise UserError("found a file, wanted a folder", field=option, given=folder)
        _make(folder)
        tempfile.TemporaryFile(dir=folder).close()
        for name in names:
            if (folder / name).is_dir():
                raise UserError(f"{folder / name} is a folder", field=option, wanted="a file there")
            _refuse_loss(option, folder / name)
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
        _make(_RUNS)
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


def _make(folder: Path) -> None:
    """Make a folder and those above it; remove at the end those that nothing was written into."""
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    folder.mkdir(parents=True, exist_ok=True)

    def remove() -> None:
        with suppress(OSError):
            for each in made:
                each.rmdir()

    if made:
        _at_the_end(remove)


def _refuse_loss(option: str, path: Path) -> None:
    if not is_forced() and would_be_lost(path):
        raise UserError(
            "found a file, which would be lost",
            field=option,
            given=path,
            advice="name another place, or give --force to replace it",
        )


def _at_the_end(close: Callable[[], None]) -> None:
    click.get_current_context().call_on_close(close)
