"""What the commands share: the CONFIG argument, ``--set``, ``--json``, and JSON without NaN."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import PurePath
from typing import Any, TypeVar

import click

from controller.errors import UserError

Command = TypeVar("Command", bound=Callable[..., Any])


def config_argument(default: str | None = None) -> Callable[[Command], Command]:
    """The CONFIG argument, handed to the command as ``config``.

    Args:
        default: What it is when it is left out; None: it must be given.
    """
    if default is None:
        return click.argument("config", metavar="CONFIG")
    return click.argument("config", metavar="[CONFIG]", default=default)


def set_option(command: Command) -> Command:
    """``--set PATH=VALUE``, any number of times, handed to the command as ``sets``."""
    return click.option(
        "--set",
        "sets",
        multiple=True,
        metavar="PATH=VALUE",
        help="Change one value of CONFIG, e.g. --set wall.stiffness=20 (repeatable).",
    )(command)


def json_option(command: Command) -> Command:
    """``--json``, handed to the command as ``as_json_wanted``."""
    return click.option(
        "--json", "as_json_wanted", is_flag=True, help="Print one JSON object and nothing else."
    )(command)


def as_json(value: Mapping[str, Any]) -> str:
    """One JSON object as text, in which what is not a finite number is null.

    Args:
        value: Anything made of mappings, sequences, numbers (NumPy's too), texts and paths.

    Raises:
        TypeError: It holds something that JSON cannot.
    """
    return json.dumps(_plain(value), ensure_ascii=False, indent=2, allow_nan=False)


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
