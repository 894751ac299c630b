"""What the commands share: CONFIG, ``--set``, ``--json``, and how answers and files are written."""

from __future__ import annotations

import errno
import json
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, TypeVar

import click
from click.shell_completion import CompletionItem

from haptic_wall.controller.cli.working import aside
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.printable import printable

Command = TypeVar("Command", bound=Callable[..., Any])


def config_argument(default: str | None = None) -> Callable[[Command], Command]:
    """The CONFIG argument, handed to the command as ``config``.

    Args:
        default: What it is when it is left out; None: it must be given.
    """
    if default is None:
        return click.argument("config", metavar="CONFIG", shell_complete=_configurations)
    return click.argument(
        "config", metavar="[CONFIG]", default=default, shell_complete=_configurations
    )


def _configurations(
    _context: click.Context, _parameter: click.Parameter, begun: str
) -> list[CompletionItem]:
    """Presets and files that begin so, for a shell that completes a word."""
    from haptic_wall.controller.settings.load import preset_names

    presets = [CompletionItem(name) for name in preset_names() if name.startswith(begun)]
    return [*presets, CompletionItem(begun, type="file")]


def _paths_of_config(
    _context: click.Context, _parameter: click.Parameter, begun: str
) -> list[CompletionItem]:
    """Paths of the configuration that begin so."""
    from haptic_wall.controller.settings.fields import fields

    return [CompletionItem(f"{path}=") for path in fields() if path.startswith(begun)]


def set_option(command: Command) -> Command:
    """``--set PATH=VALUE``, any number of times, handed to the command as ``sets``."""
    return click.option(
        "--set",
        "sets",
        multiple=True,
        metavar="PATH=VALUE",
        shell_complete=_paths_of_config,
        help="Change one value of CONFIG, e.g. --set wall.stiffness=20 (repeatable).",
    )(command)


def json_option(command: Command) -> Command:
    """``--json``, handed to the command as ``as_json_wanted``."""
    return click.option(
        "--json", "as_json_wanted", is_flag=True, help="Print one JSON object and nothing else."
    )(command)


def as_json(value: Mapping[str, Any]) -> str:
    """One JSON object as ASCII text, whatever the terminal; what is not finite is null.

    Args:
        value: Anything made of mappings, sequences, numbers (NumPy's too), texts and paths.

    Raises:
        TypeError: It holds something that JSON cannot.
    """
    text = json.dumps(_plain(value), indent=2, allow_nan=False)
    return text.replace("\x7f", "\\u007f")  # the one control character that JSON takes as it is


def _plain(value: Any) -> Any:  # noqa: ANN401 - whatever a report holds
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    if isinstance(value, PurePath):
        return str(value)
    if hasattr(value, "tolist"):  # NumPy's scalars and arrays
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


@dataclass(slots=True)
class _Command:
    answered: bool = False
    output_taken: bool = False


_command = _Command()


def begin() -> None:
    """A command begins, which has not answered yet."""
    _command.answered = _command.output_taken = False


def is_answered() -> bool:
    """Whether the command has printed its answer: on standard output there is one at most."""
    return _command.answered


class FileToWrite(click.Path):
    """A file's place; ``-`` is standard output, which is then the file's alone."""

    name = "file"

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:  # noqa: ANN401 - click's signature
        """The path."""
        if str(value) != "-":
            return super().convert(value, param, ctx)
        _command.output_taken = True
        return Path("/dev/stdout")


def say(text: str) -> None:
    """Tell a person on standard error; that nobody listens is no reason to end.

    Here, and in ``answer``, control characters become escapes, whoever wrote the text.
    """
    with suppress(OSError), aside():
        click.echo(printable(text), err=True)


def answer(text: str) -> None:
    """Print a command's answer on standard output; a reader that leaves early is no error.

    Where a file goes there (``-``), the answer goes to standard error.
    """
    _command.answered = True
    try:
        with aside():
            click.echo(printable(text), err=_command.output_taken)
            sys.stdout.flush()
    except OSError as error:
        # ``| head``, or the terminal is closed: the exit status still tells how the command ended
        if error.errno not in (errno.EPIPE, errno.EIO):
            raise
        forget_output()


def forget_output() -> None:
    """Python flushes standard output once more at exit, and would fail again: give it a place."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def refuse_same_file(named: Mapping[str, Path | None]) -> None:
    """Refuse to write one file over another.

    Args:
        named: Each option or argument, and the file it names, if any.

    Raises:
        UserError: Two of them name one file, or one cannot be looked at.
    """
    seen: dict[Path, str] = {}
    for name, path in named.items():
        try:
            if path is None or (path.exists() and not path.is_file()):
                continue  # a device (/dev/null) may take any number
            place = path.resolve()
        except (OSError, RuntimeError) as error:  # RuntimeError: links that lead in a circle
            reason = error.strerror if isinstance(error, OSError) else "its links lead in a circle"
            if isinstance(error, FileNotFoundError):  # from asking what a relative path is to
                reason = "the working folder is gone"
            raise UserError(f"{name} {path}: {reason}; name another place") from error
        first = seen.setdefault(place, name)
        if first != name:
            raise UserError(f"{first} and {name} both name {path}; give each a file of its own")


def refuse_no_folder(option: str, path: Path) -> None:
    """Refuse a place for a folder where something else is.

    Raises:
        UserError: Something else is there, or it cannot be looked at.
    """
    with writing(option, path):
        if path.exists() and not path.is_dir():
            raise UserError(f"{option} {path}: found a file, wanted a folder; name another place")


def refuse_other_pictures(option: str, path: Path) -> None:
    """Refuse a name that promises another kind of picture than PNG.

    Raises:
        UserError: It has a suffix, and another one.
    """
    if path.suffix.lower() not in ("", ".png"):
        raise UserError(
            f"{option} {path}: found a name ending in {path.suffix}, wanted one ending in .png:"
            " pictures are PNG"
        )


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
            f"{option} {path}: cannot be written: {error.strerror or error}; name another place"
        ) from error
