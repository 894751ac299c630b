"""Shared parts of the commands: CONFIG, ``--set``, ``--json``, output of answers and files."""

from __future__ import annotations

import errno
import json
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PurePath
from typing import Any, TypeVar

import click
from click.shell_completion import CompletionItem

from haptic_wall.controller.cli import interrupt
from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.working import aside
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.json_text import plain
from haptic_wall.controller.system.printable import printable

Command = TypeVar("Command", bound=Callable[..., Any])


def config_argument(
    default: str | None = None, *, needed: bool = True
) -> Callable[[Command], Command]:
    """Add the CONFIG argument, passed to the command as ``config``.

    Args:
        default: Its default; None: it is required.
        needed: A missing one without default is refused; False: it is None.
    """
    return click.argument(
        "config",
        metavar="CONFIG" if default is None else "[CONFIG]",
        required=default is None and needed,
        default=default,
        shell_complete=_configurations,
    )


def _configurations(_context: object, _parameter: object, begun: str) -> list[CompletionItem]:
    """Presets and files that begin so, for a shell that completes a word."""
    from haptic_wall.controller.settings.load import preset_names

    presets = [CompletionItem(name) for name in preset_names() if name.startswith(begun)]
    return [*presets, CompletionItem(begun, type="file")]


def _paths_of_config(_context: object, _parameter: object, begun: str) -> list[CompletionItem]:
    """Paths of the configuration that begin so."""
    from haptic_wall.controller.settings.fields import fields

    return [CompletionItem(f"{path}=") for path in fields() if path.startswith(begun)]


def set_option(command: Command) -> Command:
    """Add ``--set PATH=VALUE``, repeatable, passed to the command as ``sets``."""
    return click.option(
        "--set",
        "sets",
        multiple=True,
        metavar="PATH=VALUE",
        shell_complete=_paths_of_config,
        help="Change one value of CONFIG, e.g. --set wall.stiffness=20 (repeatable).",
    )(command)


def json_option(command: Command) -> Command:
    """Add ``--json``, passed to the command as ``as_json_wanted``."""
    return click.option(
        "--json", "as_json_wanted", is_flag=True, help="Print one JSON object and nothing else."
    )(command)


def place_option(command: Command) -> Command:
    """Add ``--at HOST:PORT``, where a page is served, as parameter ``place``."""
    return click.option(
        "--at",
        "place",
        metavar="HOST:PORT",
        default="localhost:0",
        help="Address to listen on; default: a free port, for this machine only.",
    )(command)


def stretch_options(command: Command) -> Command:
    """Add ``--from`` and ``--to``, which choose a stretch of a log, as ``start_s``, ``end_s``."""
    for option, name, text in (("--to", "end_s", "End"), ("--from", "start_s", "Start")):
        command = click.option(
            option, name, type=Number(0.0), metavar="S", help=f"{text} of the stretch [s]."
        )(command)
    return command


def stretch_between(start_s: float | None, end_s: float | None) -> tuple[float, float]:
    """Return the stretch that these options choose [s].

    Raises:
        UserError: It is empty.
    """
    if start_s is not None and end_s is not None and start_s >= end_s:
        raise UserError(
            f"found {end_s:g}", field="--to", wanted=f"more than --from, which is {start_s:g}"
        )
    return -math.inf if start_s is None else start_s, math.inf if end_s is None else end_s


def as_json(value: Mapping[str, Any]) -> str:
    """Return one JSON object as ASCII text; values that are not finite become null.

    Args:
        value: Made of mappings, sequences, numbers (NumPy's too), texts and paths.

    Raises:
        TypeError: It holds something that JSON cannot.
    """
    text = json.dumps(plain(value), indent=2, allow_nan=False)
    return text.replace("\x7f", "\\u007f")  # the one control character that JSON takes as it is


_output_taken = [False]


def begin(json: bool) -> None:
    """Note that the command has printed no answer yet, and owes an object if ``json``."""
    interrupt.owe(json)
    _output_taken[0] = False


class FileToWrite(click.Path):
    """A file's path; ``-`` is standard output, which then belongs to the file."""

    name = "file"

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:  # noqa: ANN401 - click's signature
        """The path."""
        if str(value) != "-":
            return super().convert(value, param, ctx)
        _output_taken[0] = True
        return Path("/dev/stdout")


def say(text: str) -> None:
    """Print text for a person on standard error; a missing reader is no error.

    Here, and in ``answer``, control characters become escapes.
    """
    with suppress(OSError), aside():
        click.echo(printable(text), err=True)


def answer(text: str) -> None:
    """Print a command's answer on standard output; a reader that leaves early is no error.

    Where a file goes there (``-``), the answer goes to standard error.
    """
    interrupt.owe(False)
    try:
        with aside():
            click.echo(printable(text), err=_output_taken[0])
            sys.stdout.flush()
    except OSError as error:
        # ``| head``, or a closed terminal: the exit status remains
        if error.errno not in (errno.EPIPE, errno.EIO):
            raise
        forget_output()


def forget_output() -> None:
    """Redirect standard output, which Python flushes again at exit and which would fail again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def refuse_same_file(named: Mapping[str, Path | None]) -> None:
    """Refuse to write one file over another.

    Args:
        named: Each option or argument, and the file it names, if any.

    Raises:
        UserError: Two of them name one file.
    """
    seen: dict[str, str] = {}
    for name, path in named.items():
        if path is None:
            continue
        with writing(name, path):
            if path.exists() and not path.is_file():
                continue  # a device (/dev/null) may have many writers
        first = seen.setdefault(os.path.realpath(path), name)
        if first != name:
            raise UserError(
                field=first,
                given=f"and {name} both name {path}",
                advice="give each a file of its own",
            )


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


@contextmanager
def reading(name: str, path: PurePath, wanted: str) -> Iterator[None]:
    """Turn a file that cannot be read into the user's error, naming the option or argument.

    Args:
        name: Name of the option or argument.
        path: Path of the file.
        wanted: What the file should be.

    Raises:
        UserError: In place of any OSError inside.
    """
    try:
        yield
    except OSError as error:
        raise UserError(
            f"cannot be read: {error.strerror}", field=name, given=path, advice=f"wanted {wanted}"
        ) from None


@contextmanager
def writing(option: str, path: PurePath) -> Iterator[None]:
    """Turn a file that cannot be written into the user's error, naming the option.

    Raises:
        UserError: In place of any OSError inside.
    """
    try:
        yield
    except OSError as error:
        raise UserError(
            f"cannot be written: {error.strerror or error}",
            field=option,
            given=path,
            advice="name another place",
        ) from error
