"""Reports a failed command: text on standard error, and with --json an object for programs.

The object is ``{error, field, advice, exit_status}``. Messages have one style everywhere:
``FIELD: what was found, wanted what; what to do``; of a servo, and of this machine,
``What is wrong with it: what to do``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import click

from haptic_wall.controller.cli.advice import for_option
from haptic_wall.controller.cli.options import answer, as_json, forget_output, is_answered, say
from haptic_wall.controller.errors import ConfigError, HapticWallError
from haptic_wall.hw.errors import ServoError

_FIELD = re.compile(r"--[a-z][a-z-]*|[A-Z]{3,}(?= |:)|[a-z]+\.[a-z_]+")
"""An option, an argument or a configuration path, at the beginning of a message"""
_NO_NUMBER = re.compile(r"(.*) is not a valid (float|integer)(?: range)?\.")


class EndedEarlyError(HapticWallError):
    """A person or a trip has ended a command before it had an answer.

    Args:
        text: For people.
        exit_status: Of the command.
    """

    def __init__(self, text: str, exit_status: int) -> None:
        super().__init__(text)
        self.exit_status = exit_status


def wants_json(arguments: Sequence[str]) -> bool:
    """Whether a command line asks for JSON."""
    return "--json" in arguments


def tell(error: BaseException, status: int, *, json: bool, arguments: Sequence[str] = ()) -> int:
    """Report an error; return its exit status.

    Args:
        error: The error; without a text it is Ctrl-C, which needs no explanation.
        status: Exit status.
        json: Also print the object for programs, unless the answer is already printed.
        arguments: Of the command line.
    """
    text = str(error) or "interrupted"
    if isinstance(error, click.ClickException):
        text = _in_one_style(error, arguments)
    if str(error):
        say(f"haptic-wall: {text}")
    if json and not is_answered():
        try:
            answer(as_json(_failure(error, text, status)))
        except OSError:  # a full disk: the exit status remains
            forget_output()
    return status


def _in_one_style(error: click.ClickException, arguments: Sequence[str]) -> str:
    """Word click's error like the other errors."""
    context = error.ctx if isinstance(error, click.UsageError) else None
    more = f"`{context.command_path} --help` lists what there is" if context else ""
    if isinstance(error, click.NoSuchOption):
        advice = for_option(error, arguments) or more
        return "; ".join(filter(None, [f"{error.option_name}: no such option", advice]))
    if isinstance(error, click.MissingParameter) and error.param is not None:
        return "; ".join(filter(None, [f"{_field(error, '')}: missing", more]))
    if isinstance(error, click.BadParameter) and error.param is not None:
        said = _NO_NUMBER.fullmatch(error.message)
        if said is None:
            return f"{_field(error, '')}: {error.message}"
        whole = " whole" if said[2] == "integer" else ""
        return f"{_field(error, '')}: found {said[1]}, wanted a{whole} number"
    return error.format_message()


def _failure(error: BaseException, text: str, status: int) -> dict[str, Any]:
    first = error.problems[0] if isinstance(error, ConfigError) else text
    _, mark, advice = first.rpartition("; ")
    if not mark and isinstance(error, ServoError | OSError):
        _, mark, advice = first.rpartition(": ")
    if not mark:
        _, mark, advice = first.rpartition(", wanted ")
        advice = f"wanted {advice}"
    return {
        "error": text,
        "field": _field(error, first),
        "advice": advice if mark else None,
        "exit_status": status,
    }


def _field(error: BaseException, text: str) -> str | None:
    if isinstance(error, click.NoSuchOption):
        return error.option_name
    if isinstance(error, click.BadParameter) and error.param is not None:
        option = isinstance(error.param, click.Option)
        return error.param.opts[0] if option else error.param.human_readable_name.strip("[]")
    found = _FIELD.match(text)
    return found and found.group()
