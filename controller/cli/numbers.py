"""Reads numbers from the command line: within bounds, lists, and ranges LOW:HIGH.

Lists and ranges are callbacks of options that take text, so that a message names the option.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

import click

from haptic_wall.controller.cli.refusals import WrongValueError
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.guard.belief import Bounded
from haptic_wall.hw.errors import Problem

_DIGITS = 9
"""Largest number of digits of an id or firmware; Python refuses numbers of thousands"""


class Number(click.types.FloatParamType):
    """A finite number within bounds, of which each may be left out.

    Args:
        low: Smallest number.
        high: Largest number.
        above: Whether ``low`` itself is refused.
    """

    def __init__(
        self, low: float = -math.inf, high: float = math.inf, *, above: bool = False
    ) -> None:
        self._low, self._high = low, high
        self._without = (low,) if above else ()

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's signature
        param: click.Parameter | None,
        ctx: click.Context | None,  # noqa: ARG002 - click's signature
    ) -> float:
        """Read the number; raise if it is none, or outside of the bounds."""
        number = _number(str(value))
        if number is None or not self._low <= number <= self._high or number in self._without:
            raise WrongValueError(Problem(f"found {value}", wanted=self._wanted()), param)
        return number

    def _wanted(self) -> str:
        if self._low == -math.inf:
            return "a number"
        low = f"a number {'above' if self._without else 'from'} {self._low:g}"
        return low if self._high == math.inf else f"{low}, up to {self._high:g}"


def numbers(_: click.Context, parameter: click.Parameter, text: str | None) -> list[float] | None:
    """Read numbers separated by commas, also negative ones: ``-0.01,0.2``.

    Raises:
        BadParameter: One is not a finite number.
    """
    if text is None:
        return None
    found = [_number(part) for part in text.split(",")]
    good = [number for number in found if number is not None]
    if len(good) < len(found):
        wanted = "numbers with commas between, such as -0.01,0.2"
        raise WrongValueError(Problem(f"found {text!r}", wanted=wanted), parameter)
    return good


def periods(_: click.Context, parameter: click.Parameter, text: str | None) -> list[float] | None:
    """Read numbers of whole periods separated by commas: ``0,5``.

    Raises:
        BadParameter: One is not a whole number from 0 up.
    """
    if text is None:
        return None
    found = [_number(part) for part in text.split(",")]
    good = [number for number in found if number is not None and number >= 0 == number % 1]
    if len(good) < len(found):
        wanted = "whole periods from 0 up with commas between, such as 0,5"
        raise WrongValueError(Problem(f"found {text!r}", wanted=wanted), parameter)
    return good


def whole_periods(values: Collection[float], most: int) -> list[int]:
    """Return the values of ``--delay-steps`` as whole numbers.

    Args:
        values: As given [periods].
        most: The largest [periods].

    Raises:
        UserError: One is not a whole number from 0 to ``most``.
    """
    for value in values:
        if value != int(value) or not 0 <= value <= most:
            raise UserError(
                f"found {value:g}", field="--delay-steps", wanted=f"whole periods from 0 to {most}"
            )
    return [int(value) for value in values]


def span(_: click.Context, parameter: click.Parameter, text: str | None) -> Bounded | None:
    """Read a number, or a range ``LOW:HIGH`` whose middle is the estimate.

    Raises:
        BadParameter: It is neither.
    """
    if text is None:
        return None
    match [_number(end) for end in text.split(":")]:
        case [float(only)]:
            return Bounded.exactly(only)
        case [float(low), float(high)] if low <= high:
            return Bounded((low + high) / 2, low, high)
        case [float(low), float(high)]:
            wanted = f"the lower end first: {high:g}:{low:g}"
        case _:
            wanted = "a number, or a range LOW:HIGH"
    raise WrongValueError(Problem(f"found {text!r}", wanted=wanted), parameter)


def digits(text: str) -> int | None:
    """Return a whole number of a few digits, such as an id; None: it is none."""
    return int(text) if text.strip().isdecimal() and len(text) <= _DIGITS else None


def _number(text: str) -> float | None:
    """Return a finite number, or None."""
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
