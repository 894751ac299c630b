"""Reports a failed command: text on standard error, and with --json an object for programs.

The object is ``{error, field, advice, exit_status}``. Messages have one style everywhere:
``FIELD: what was found, wanted what; what to do``; of a servo, and of this machine,
``What is wrong with it: what to do``.
"""

from __future__ import annotations

import click

from haptic_wall.controller.cli.options import answer_error, forget_output, say
from haptic_wall.controller.errors import HapticWallError
from haptic_wall.hw.errors import ExplainedError, Problem
from haptic_wall.hw.names import did_you_mean


class EndedEarlyError(HapticWallError):
    """A person or a trip has ended a command before it had an answer."""

    def __init__(self, problem: Problem | str, exit_status: int) -> None:
        super().__init__(problem)
        self.exit_status = exit_status


def tell(error: BaseException, status: int) -> int:
    """Report an error; return its exit status.

    Args:
        error: The error; without a text it is Ctrl-C.
        status: Exit status.
    """
    problem = _problem(error)
    text = str(problem if isinstance(error, click.ClickException) else error) or "interrupted"
    say(f"haptic-wall: {text}")
    told = {"error": text, "field": problem.field, "advice": problem.remedy}
    try:
        answer_error({**told, "exit_status": status})
    except OSError:  # a full disk: the exit status remains
        forget_output()
    return status


def _problem(error: BaseException) -> Problem:
    """Return the parts of an error's sentence, also of click's."""
    if isinstance(error, ExplainedError):
        return error.problem
    if not isinstance(error, click.ClickException):
        return Problem(str(error))
    context = error.ctx if isinstance(error, click.UsageError) else None
    advice = f"`{context.command_path} --help` lists options and arguments" if context else ""
    if isinstance(error, click.NoSuchOption):
        name = error.option_name.lstrip("-")  # dashes alone make names alike
        near = [
            each for each in sorted(error.possibilities or ()) if did_you_mean(name, [each[2:]])
        ]
        advice = f"did you mean {' or '.join(near)}?" if near else advice
        for each in context.command.params if context else ():
            if each.name == "sets":
                advice = f"a setting is changed with --set {each.metavar}; {advice}"
        return Problem("no such option", advice=advice, field=error.option_name)
    if isinstance(error, click.BadParameter) and error.param is not None:
        is_option = isinstance(error.param, click.Option)
        field = error.param.opts[0] if is_option else error.param.human_readable_name.strip("[]")
        if isinstance(error, click.MissingParameter):
            return Problem("missing", advice=advice, field=field)
        return Problem(error.message.rstrip("."), field=field)
    return Problem(error.format_message().rstrip("."), advice=advice)
