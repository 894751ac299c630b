"""Shared parts of the commands: CONFIG, ``--set``, ``--json``, answers, errors of files."""

from __future__ import annotations

import errno
import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import PurePath
from typing import Any, TypeVar

import click

from haptic_wall.controller.cli import interrupt
from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.working import aside
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.json_text import plain
from haptic_wall.controller.system.printable import printable

Command = TypeVar("Command", bound=Callable[..., Any])


def begin(json: bool) -> None:
    """Note whether ``--json`` is given, and that nothing is printed yet."""
    interrupt.json = interrupt.due = json


def config_argument(
    default: str | None = None, *, needed: bool = True
) -> Callable[[Command], Command]:
    """Add the CONFIG argument, passed to the command as ``config``.

    Args:
        default: Its default; None: it is required.
        needed: A missing one without default is refused; False: it is None.
    """
    if default is None and needed:  # a default of None counts as given since click 8.3
        return click.argument("config", metavar="CONFIG")
    return click.argument("config", metavar="[CONFIG]", required=False, default=default)


set_option = click.option(
    "--set",
    "sets",
    multiple=True,
    metavar="PATH=VALUE",
    help="Change one value of CONFIG, e.g. --set wall.stiffness=20 (repeatable); of one of several "
    "axes --set axes.NAME.wall.stiffness=20.",
)
axis_option = click.option(
    "--axis", metavar="NAME", help="The axis, where CONFIG has several; others stay torque off."
)
json_option = click.option(
    "--json",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=lambda _context, _option, given: begin(given),
    help="Print one JSON object and nothing else.",
)
"""``answer`` obeys it"""
place_option = click.option(
    "--at",
    "place",
    metavar="HOST:PORT",
    default="localhost:0",
    help="Address to listen on; default: a free port, for this machine only.",
)
"""Where a page is served"""


def stretch_options(command: Command) -> Command:
    """Add ``--from`` and ``--to``, which choose a stretch of a log, as ``start_s``, ``end_s``."""
    for option, name, text in (("--to", "end_s", "End"), ("--from", "start_s", "Start")):
        help_ = f"{text} of the stretch [s]."
        command = click.option(option, name, type=Number(0.0), metavar="S", help=help_)(command)
    return command


def stretch_between(start_s: float | None, end_s: float | None) -> tuple[float, float]:
    """Return the stretch that these options choose [s].

    Raises:
        UserError: It is empty.
    """
    low, high = start_s or -math.inf, math.inf if end_s is None else end_s
    if high <= max(0.0, low):
        wanted = f"more than --from, which is {max(0.0, low):g}"
        raise UserError(f"found {high:g}", field="--to", wanted=wanted)
    return low, high


def as_json(value: Mapping[str, Any]) -> str:
    """Return one JSON object as ASCII text; values that are not finite become null.

    Args:
        value: Made of mappings, sequences, numbers (NumPy's too), texts and paths.

    Raises:
        TypeError: It holds something that JSON cannot.
    """
    text = json.dumps(plain(value), indent=2, allow_nan=False)
    return text.replace("\x7f", "\\u007f")  # the one control character that JSON takes as it is


def wants_json() -> bool:
    """Whether the command has ``--json``."""
    return interrupt.json


def say(text: str) -> None:
    """Print text for a person on standard error; a missing reader is no error.

    Here, and in ``put``, control characters become escapes.
    """
    with suppress(OSError), aside():
        click.echo(printable(text), err=True)


def put(text: str) -> None:
    """Print a text on standard output; a reader that leaves early is no error."""
    interrupt.due = False
    try:
        with aside():
            click.echo(printable(text))
            sys.stdout.flush()
    except OSError as error:
        # ``| head``, or a closed terminal: the exit status remains
        if error.errno not in (errno.EPIPE, errno.EIO):
            raise
        forget_output()


def answer(report: Mapping[str, Any], text: Callable[[], str]) -> None:
    """Print a command's answer: the report with ``--json``, else the text, made only then."""
    put(as_json(report) if wants_json() else text())


def written(paths: Iterable[object]) -> list[str]:
    """Return the lines of an answer that name the files which were written."""
    return ["written", *(f"  {path}" for path in paths)]


def answer_error(error: Mapping[str, Any]) -> None:
    """Print an error's object where ``--json`` is given and no answer has been printed."""
    if interrupt.due:
        put(as_json(error))


def forget_output() -> None:
    """Redirect standard output, which Python flushes again at exit and which would fail again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


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
