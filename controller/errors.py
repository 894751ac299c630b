"""Defines the controller's errors as one tree.

::

    HapticWallError
    ├── UserError (also ValueError)     the user's input is wrong: exit status 2
    │   ├── ConfigError                 the configuration, with every problem found in it
    │   └── LogFormatError              the file is not a log of this program
    └── PlatformError (also OSError)    this machine cannot run the loop: exit status 4

Hardware errors are ``haptic_wall.hw.errors.ServoError``. All carry the parts of their sentence, see
``haptic_wall.hw.errors.Problem``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from haptic_wall.hw.errors import ExplainedError, Problem

EXIT_STATUSES: Final[Mapping[int, str]] = {
    0: "done",
    1: "`doctor` found something wrong",
    2: "the input is wrong",
    3: "a safety trip ended the run, or its wall never came on or has no stiffness at the end",
    4: "the hardware could not be reached, is unfit, or was lost",
    5: "the run went well, but its log is missing or incomplete",
    130: "interrupted, by Ctrl-C or SIGTERM",
}
"""Of every command; 3, 4 and 130 take precedence over 5"""
_MOST_TOLD = 30
"""Largest number of a configuration's problems in the message"""


class HapticWallError(ExplainedError):
    """Any refusal of this program, with the command's exit status."""

    exit_status: int = 4


class UserError(HapticWallError, ValueError):
    """The user's input is wrong."""

    exit_status = 2


class ConfigError(UserError):
    """The configuration is wrong.

    Args:
        source: The preset or file, as a person would name it.
        problems: Every problem found; the first stands for the error.

    Attributes:
        problems: One line for each problem, beginning with the field's path.
    """

    def __init__(self, source: str, problems: Sequence[Problem]) -> None:
        count = f"{len(problems)} problem{'s' if len(problems) > 1 else ''}"
        told = [f"  {problem}" for problem in problems[:_MOST_TOLD]]
        if len(problems) > _MOST_TOLD:
            told.append(f"  ... and {len(problems) - _MOST_TOLD} more")
        super().__init__("\n".join([f"configuration {source}: {count}", *told]))
        self.problem = problems[0]
        self.problems = tuple(map(str, problems))


class LogFormatError(UserError):
    """The file is not a log of this program."""


class PlatformError(HapticWallError, OSError):
    """This machine cannot run the loop."""

    mark = ": "
