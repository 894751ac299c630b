"""Defines the errors of the command line as Click's, with found and wanted values as data."""

from __future__ import annotations

import click

from haptic_wall.hw.errors import Problem


class WrongValueError(click.BadParameter):
    """A parameter's value cannot be read."""

    def __init__(self, problem: Problem, parameter: click.Parameter | None) -> None:
        super().__init__(str(problem), param=parameter)
        self.problem = problem


class NoSuchCommandError(click.UsageError):
    """There is no command of this name."""

    def __init__(self, problem: Problem, context: click.Context) -> None:
        super().__init__(str(problem), context)
        self.problem = problem
