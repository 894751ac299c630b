"""Reads numbers from the command line: within bounds, and lists."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

import click

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
        form: ``list``: numbers with commas between, also negative ones, as a list.
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
        form: Literal["one", "list"] = "one",
    ) -> None:
        self._low, self._high, self._above, self._is_whole = low, high, above, whole
        self._form = form
        self._wanted = "a whole number" if whole else "a number"
        if low > -math.inf:
            self._wanted += f" {'above' if above else 'from'} {low:g}"
        if high < math.inf:
            self._wanted += f", up to {high:g}"
        self._wanted += f" {unit}" if unit else ""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:  # noqa: ANN401 - click's signature
        """Read one number or several; refuse all where one is none, or outside of the bounds."""
        text = str(value)
        if self._form == "one":
            return self._read(text, param, ctx)
        return [self._read(part, param, ctx) for part in text.split(",")]

    def _read(self, text: str, param: click.Parameter | None, ctx: click.Context | None) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        fits = self._low <= number <= self._high and not (self._above and number == self._low)
        if not math.isfinite(number) or not fits or (self._is_whole and number % 1):
            self.fail(f"found {text}, wanted {self._wanted}", param, ctx)
        return int(number) if self._is_whole else number
