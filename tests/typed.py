"""Values of a type that the checker cannot know and the test does."""

from __future__ import annotations

from typing import TypeVar

T = TypeVar("T")


def not_none(value: T | None) -> T:
    """The value, which is there."""
    assert value is not None
    return value


def status_of(ended: SystemExit) -> int:
    """The exit status of a program that ended itself."""
    assert isinstance(ended.code, int)
    return ended.code
