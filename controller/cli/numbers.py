"""Reads numbers from the command line: within bounds, lists, and ranges LOW:HIGH."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from haptic_wall.controller.guard.belief import Bounded

if TYPE_CHECKING:
    AnyType = click.ParamType[Any]
else:
    AnyType = click.ParamType  # generic in newer versions only


class Number(AnyType):
    """A finite number within bounds, of which each may be left out.

    Args:
        low: Smallest number.
        high: Largest number.
        above: Whether ``low`` itself is refused.
        whole: Whether only whole numbers are taken; they become int.
        unit: Unit that a refusal names.
    """

    name = "number"

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
        self._wanted = "a whole number" if whole else "a number"
        if low > -math.inf:
            self._wanted += f" {'above' if above else 'from'} {low:g}"
        if high < math.inf:
            self._wanted += f", up to {high:g}"
        self._wanted += f" {unit}" if unit else ""

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's signature
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> float:
        """Read the number; refuse one that is none, or outside of the bounds."""
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        fits = self._low <= number <= self._high and not (self._above and number == self._low)
        if not math.isfinite(number) or not fits or (self._is_whole and number % 1):
            self.fail(f"found {value}, wanted {self._wanted}", param, ctx)
        return int(number) if self._is_whole else number


class Numbers(AnyType):
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
        """Read the numbers; refuse all where one is refused."""
        return [self._of.convert(part, param, ctx) for part in str(value).split(",")]


class Span(AnyType):
    """A number, or a range ``LOW:HIGH`` whose middle is the estimate.

    Args:
        of: Reads each end.
    """

    name = "span"

    def __init__(self, of: Number) -> None:
        self._of = of

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's signature
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> Bounded:
        """Read the number or range; refuse one whose lower end is not first."""
        ends = [self._of.convert(end, param, ctx) for end in str(value).split(":", 1)]
        if ends[0] > ends[-1]:
            self.fail(f"found {value}, wanted the lower end first", param, ctx)
        return Bounded(sum(ends) / len(ends), ends[0], ends[-1])
