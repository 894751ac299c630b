"""Reads numbers and names from text; each reader's docstring names the accepted values."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from haptic_wall.hw.names import did_you_mean


def number(low: float, high: float, *, open_low: bool = False) -> Callable[[str], float]:
    """Return a reader of numbers in a range; its docstring names the range.

    Args:
        low: The smallest.
        high: The largest.
        open_low: ``low`` itself is out of range.
    """

    def parse(text: str) -> float:
        value = float(text)
        if not (low < value if open_low else low <= value) or not value <= high:
            raise ValueError
        return value

    parse.__doc__ = f"a number {'above' if open_low else 'from'} {low:g} up to {high:g}"
    return parse


def whole(low: int, high: int) -> Callable[[str], int]:
    """Return a reader of whole numbers in a range; its docstring names the range."""

    def parse(text: str) -> int:
        value = float(text)
        if not value.is_integer() or not low <= value <= high:
            raise ValueError
        return int(value)

    parse.__doc__ = f"a whole number from {low} to {high}"
    return parse


def one_of(*choices: Any) -> Callable[[str], Any]:  # noqa: ANN401 - texts or numbers
    """Return a reader of one of these values, by its text; its docstring lists them."""

    def parse(text: str) -> Any:  # noqa: ANN401
        return {str(choice): choice for choice in choices}[text]

    parse.__doc__ = "one of " + ", ".join(map(str, choices))
    return parse


def suggestion(found: str, known: Iterable[str], prefix: str = "") -> str:
    """Return advice on an unknown name: the nearest known one, or all."""
    names = list(known)
    return did_you_mean(found, names, prefix) or f"known are {', '.join(names)}"
