"""The controller's errors as one tree; messages say what was found, what is wanted, what to do.

::

    HapticWallError
    ├── UserError (also ValueError)     the user's input is wrong: exit status 2
    │   ├── ConfigError                 the configuration, with every problem found in it
    │   └── LogFormatError              the file is not a log of this program
    └── PlatformError (also OSError)    this machine cannot run the loop: exit status 4

Hardware errors are ``haptic_wall.hw.errors.ServoError``.
"""

from __future__ import annotations

_MOST_TOLD = 30
"""Largest number of a configuration's problems in the message"""


class HapticWallError(Exception):
    """Any refusal of this program, with the command's exit status."""

    exit_status: int = 4


class UserError(HapticWallError, ValueError):
    """The user's input is wrong."""

    exit_status = 2


class ConfigError(UserError):
    """The configuration is wrong.

    Args:
        source: The preset or file, as a person would name it.
        problems: One line for each problem, beginning with the field's path.

    Attributes:
        problems: See above.
    """

    def __init__(self, source: str, problems: list[str]) -> None:
        count = f"{len(problems)} problem{'s' if len(problems) > 1 else ''}"
        told = [f"  {problem}" for problem in problems[:_MOST_TOLD]]
        if len(problems) > _MOST_TOLD:
            told.append(f"  ... and {len(problems) - _MOST_TOLD} more")
        super().__init__("\n".join([f"configuration {source}: {count}", *told]))
        self.problems = tuple(problems)


class LogFormatError(UserError):
    """The file is not a log of this program."""


class PlatformError(HapticWallError, OSError):
    """This machine cannot run the loop."""
