"""Claims the places where a command writes: refuses conflicts before any work is done.

No existing file is touched before there is a replacement.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path

import click

from haptic_wall.controller.cli import interrupt
from haptic_wall.controller.cli.options import Command, refuse_no_folder, refuse_same_file, writing
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.claim import ClaimedError, claimed
from haptic_wall.controller.system.file_kinds import PICTURE, RESULT, Kind, may_be_replaced
from haptic_wall.controller.system.new_folders import make_and_keep, remove_empty
from haptic_wall.controller.system.whole_file import remove_leftovers

_RUNS = Path("runs")
_TAKEN = ("", ".hwlog", ".png")
"""Suffixes that may follow a new name in an existing file"""


def force_option(command: Command) -> Command:
    """Add ``--force``, passed to the command as ``force``."""
    return click.option(
        "--force", is_flag=True, help="Also replace existing files that haptic-wall did not write."
    )(command)


def take_file(
    option: str, path: Path, kind: Kind, *, force: bool, make: bool = False, try_it: bool = True
) -> None:
    """Check that a file can be written there without loss, and claim it until the command ends.

    Args:
        option: Option that names it.
        path: Path of the file.
        kind: Kind of the file.
        force: Replace any file.
        make: Make its folder if necessary.
        try_it: Refuse a folder without write permission.

    Raises:
        UserError: A folder or a file of another kind is there, or another command is writing it, or
            it cannot be written.
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
    _refuse_foreign(option, path, kind, force=force)
    with writing(option, path):
        if try_it:
            tempfile.TemporaryFile(dir=Path(os.path.realpath(path)).parent).close()
        _claim(option, path)
        with suppress(OSError):
            remove_leftovers(path)


def take_folder(
    option: str, folder: Path, kinds: Mapping[str, Kind], *, force: bool, has_force: bool = True
) -> None:
    """Check that files can be written there without loss, and claim the folder until the end.

    Args:
        option: Option that names it.
        folder: Made if necessary, and removed if it is empty at the end.
        kinds: Names and kinds of the files.
        force: Replace any files.
        has_force: The command has that option.

    Raises:
        UserError: It is no folder, or not writable, or a file is of another kind, or another
            command is writing there.
    """
    refuse_no_folder(option, folder)
    with writing(option, folder):
        _make_and_keep(folder)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UserError(
            "found a folder without write permission",
            field=option,
            given=folder,
            advice="name another place",
        )
    for name, kind in kinds.items():
        if (folder / name).is_dir():
            raise UserError(
                f"found a folder {name} in it",
                field=option,
                given=folder,
                wanted="a file or nothing",
                advice="name another place",
            )
        _refuse_foreign(option, folder / name, kind, force=force, has_force=has_force)
    with writing(option, folder):
        _claim(option, folder)
        for name in kinds:
            remove_leftovers(folder / name)


def take_link(option: str, path: Path, *, force: bool) -> None:
    """Check that a link to a terminal can be made there, and claim it until the command ends.

    Args:
        option: Option that names it.
        path: Path of the link; a link that a killed command left there leads to a terminal too.
        force: Replace any link.

    Raises:
        UserError: A link to something else is there, or another command's, or it cannot be made.
    """
    with writing(option, path):
        if not force and path.is_symlink() and not path.readlink().is_relative_to("/dev/pts"):
            raise UserError(
                f"found a link to {path.readlink()}, which would be lost",
                field=option,
                given=path,
                advice="name another place, or give --force to replace it",
            )
        _claim(option, path, follow=False)


def new_stem(option: str, what: str) -> Path:
    """Return a name in ./runs/ with which no existing name begins, claimed until the command ends.

    Args:
        option: Option that would name another place.
        what: End of the name, after date and time.

    Raises:
        UserError: The folder ./runs/ cannot be made.
    """
    _make(option, _RUNS)
    stem = _RUNS / f"{time.strftime('%Y%m%d-%H%M%S')}-{what}"
    while not _is_new(stem):  # second run within a second
        stem = stem.with_name(stem.name + "+")
    return stem


def _is_new(stem: Path) -> bool:
    """Whether the name is free; claim it then."""
    with ExitStack() as stack:
        try:
            stack.enter_context(claimed(stem))
        except ClaimedError:
            return False
        if any(os.path.lexists(f"{stem}{suffix}") for suffix in _TAKEN):
            return False
        _until_the_end(stack.pop_all().close)
    return True


def _make(option: str, folder: Path) -> None:
    try:
        _make_and_keep(folder)
    except OSError as error:
        raise UserError(
            f"the folder {folder} cannot be made ({error.strerror})",
            field=option,
            advice="name another place",
        ) from error


def _make_and_keep(folder: Path) -> None:
    _until_the_end(remove_empty)
    make_and_keep(folder)


def _refuse_foreign(
    option: str, path: Path, kind: Kind, *, force: bool, has_force: bool = True
) -> None:
    if not force and not may_be_replaced(path, kind):
        early = " (early versions did not mark theirs)" if kind in (PICTURE, RESULT) else ""
        raise UserError(
            f"found a file that is not {kind.name}{early}, and would be lost",
            field=option,
            given=path,
            advice="name another place" + ", or give --force to replace it" * has_force,
        )


def _claim(option: str, path: Path, *, follow: bool = True) -> None:
    with ExitStack() as stack:
        try:
            stack.enter_context(claimed(path, follow=follow))
        except ClaimedError:
            raise UserError(
                f"another run is writing {path}",
                field=option,
                advice="wait for its end, or name another place",
            ) from None
        _until_the_end(stack.pop_all().close)


def _until_the_end(close: Callable[[], None]) -> None:
    click.get_current_context().call_on_close(close)


interrupt.do_first(remove_empty)
