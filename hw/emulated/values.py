"""Reads numbers from text, and suggests names; a reader's docstring names the accepted values."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from haptic_wall.hw.names import did_you_mean


def number(low: float, high: float) -> Callable[[str], float]:
    """Return a reader of numbers in a range; its docstring names the range."""

    def parse(text: str) -> float:
        value = float(text)
        if not low <= value <= high:
            raise ValueError
        return value

    parse.__doc__ = f"a number from {low:g} up to {high:g}"
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


def suggestion(found: str, known: Iterable[str], prefix: str = "") -> str:
    """Return advice on an unknown name: the nearest known one, or all."""
    names = list(known)
    return did_you_mean(found, names, prefix) or f"known are {', '.join(names)}"
