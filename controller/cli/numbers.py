"""Reads numbers from the command line: within bounds, lists, and ranges LOW:HIGH.

Ranges are callbacks of options that take text, so that a message names the option.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.guard.belief import Bounded

_DIGITS = 9
"""Largest number of digits of an id or firmware; Python refuses numbers of thousands"""


class Number(click.types.FloatParamType):
    """A finite number within bounds, of which each may be left out.

    Args:
        low: Smallest number.
        high: Largest number.
        above: Whether ``low`` itself is refused.
        whole: Whether only whole numbers are taken; they become int.
        unit: Unit that a refusal names.
    """

    def __init__(
        self,
        low: float = -math.inf,
        high: float = math.inf,
        *,
        above: bool = False,
        whole: bool = False,
        unit: str = "",
    ) -> None:
        self._low, self._high, self._above, self._is_whole = low, high, above, whole
        self._unit = f" {unit}" if unit else ""

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's signature
        param: click.Parameter | None,
        ctx: click.Context | None,  # noqa: ARG002 - click's signature
    ) -> float:
        """Read the number; raise if it is none, or outside of the bounds."""
        number = _number(str(value))
        if (
            number is None
            or not self._low <= number <= self._high
            or (self._above and number == self._low)
            or (self._is_whole and number % 1)
        ):
            field = param.opts[0] if param else ""
            raise UserError(f"found {value}", field=field, wanted=self._wanted())
        return int(number) if self._is_whole else number

    def _wanted(self) -> str:
        wanted = "a whole number" if self._is_whole else "a number"
        if self._low > -math.inf:
            wanted += f" {'above' if self._above else 'from'} {self._low:g}"
        if self._high < math.inf:
            wanted += f", up to {self._high:g}"
        return wanted + self._unit


if TYPE_CHECKING:
    _OfLists = click.ParamType[list[float]]
else:
    _OfLists = click.ParamType  # generic in newer versions only


class Numbers(_OfLists):
    """Numbers with commas between, also negative ones: ``-0.01,0.2``.

    Args:
        of: Reads each of them.
    """

    name = "numbers"

    def __init__(self, of: Number) -> None:
        self._of = of

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's signature
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> list[float]:
        """Read the numbers; raise where one is refused."""
        return [self._of.convert(part, param, ctx) for part in str(value).split(",")]


def span(_: click.Context, parameter: click.Parameter, text: str | None) -> Bounded | None:
    """Read a number, or a range ``LOW:HIGH`` whose middle is the estimate.

    Raises:
        UserError: It is neither.
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
    raise UserError(f"found {text!r}", field=parameter.opts[0], wanted=wanted)


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
