"""What can go wrong on this side of the servo, as one tree; messages say found, wanted, what to do.

::

    HapticWallError
    ├── UserError (also ValueError)     the user's input is wrong: exit status 2
    │   ├── ConfigError                 the configuration, with every problem found in it
    │   └── LogFormatError              the file is not a log of ours
    └── PlatformError (also OSError)    this machine cannot run the loop: exit status 4

Hardware errors are ``haptic_wall.hw.errors.ServoError``.
"""

from __future__ import annotations

_MOST_TOLD = 30
"""Problems of a configuration that its message names"""


class HapticWallError(Exception):
    """Anything this program refuses, with the exit status of the command that met it."""

    exit_status: int = 4


class UserError(HapticWallError, ValueError):
    """The user's input is wrong."""

    exit_status = 2


class ConfigError(UserError):
    """The configuration is wrong.

    Args:
        source: The preset or file, as a person would name it.
        problems: One line for each thing that is wrong, beginning with the field's path.

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
    """The file is not a log of ours."""


class PlatformError(HapticWallError, OSError):
    """This machine cannot run the loop."""
