"""Reports a failed command: text on standard error, and with --json an object for programs.

The object is ``{error, field, advice, exit_status}``. Messages have one style everywhere:
``FIELD: what was found, wanted what; what to do``; of a servo, and of this machine,
``What is wrong with it: what to do``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import click

from haptic_wall.controller.cli.options import answer, as_json, forget_output, is_answered, say
from haptic_wall.controller.errors import HapticWallError
from haptic_wall.hw.errors import ExplainedError, Problem


def for_option(error: click.NoSuchOption, arguments: Sequence[str]) -> str:
    """Return a suggestion: a similar option, or ``--set`` with a similar path; empty if none.

    Args:
        error: The unknown option, its command, and similar names.
        arguments: Arguments of the command line, with the option's value.
    """
    name = error.option_name
    paths = _paths(error.ctx, name.lstrip("-").replace("-", "_")) if name.startswith("--") else []
    if paths:
        value = _value(name, arguments)
        return "give " + " or ".join(f"`--set {path}={value}`" for path in paths)
    near = sorted(error.possibilities or [])
    return f"did you mean {' or '.join(near)}?" if near else ""


def _paths(context: click.Context | None, name: str) -> list[str]:
    """Return the paths for ``--set`` of a command that end in a name, or equal it."""
    if context is None:
        return []
    sets = [each for each in context.command.params if each.name == "sets"]
    if not sets:
        return []
    known = [item.value.rstrip("=") for item in sets[0].shell_complete(context, "")]
    return [path for path in known if name in (path, path.partition(".")[2])]


def _value(name: str, arguments: Sequence[str]) -> str:
    """Return the value of an option; ``VALUE`` if it had none."""
    for here, following in zip(arguments, [*arguments[1:], ""], strict=True):
        if here.startswith(f"{name}="):
            return here.partition("=")[2]
        if here == name and following and not following.startswith("--"):
            return following
    return "VALUE"


class EndedEarlyError(HapticWallError):
    """A person or a trip has ended a command before it had an answer."""

    def __init__(self, problem: Problem | str, exit_status: int) -> None:
        super().__init__(problem)
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
        arguments: Arguments of the command line.
    """
    problem = _problem(error, arguments)
    text = str(problem if isinstance(error, click.ClickException) else error) or "interrupted"
    if str(error):
        say(f"haptic-wall: {text}")
    if json and not is_answered():
        try:
            answer(as_json(_failure(problem, text, status)))
        except OSError:  # a full disk: the exit status remains
            forget_output()
    return status


def _problem(error: BaseException, arguments: Sequence[str]) -> Problem:
    """Return the parts of an error's sentence, also of click's."""
    if isinstance(error, ExplainedError):
        return error.problem
    if not isinstance(error, click.ClickException):
        return Problem(str(error))
    context = error.ctx if isinstance(error, click.UsageError) else None
    more = f"`{context.command_path} --help` lists options and arguments" if context else ""
    if isinstance(error, click.NoSuchOption):
        advice = for_option(error, arguments) or more
        return Problem("no such option", advice=advice, field=error.option_name)
    if isinstance(error, click.BadParameter) and error.param is not None:
        field = _name_of(error.param)
        if isinstance(error, click.MissingParameter):
            return Problem("missing", advice=more, field=field)
        return Problem(error.message, field=field)
    return Problem(error.format_message())


def _name_of(parameter: click.Parameter) -> str:
    if isinstance(parameter, click.Option):
        return parameter.opts[0]
    return parameter.human_readable_name.strip("[]")


def _failure(problem: Problem, text: str, status: int) -> dict[str, Any]:
    return {
        "error": text,
        "field": problem.field,
        "advice": problem.remedy,
        "exit_status": status,
    }
