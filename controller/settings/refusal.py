"""Defines an error of a field whose message is already written for people."""

from __future__ import annotations

from pydantic_core import PydanticCustomError

from haptic_wall.hw.errors import Problem

IN_WORDS = "in_words"
"""Kind of such an error, and where its context holds the problem"""


def refusal(problem: Problem) -> PydanticCustomError:
    """Return the error for a validator to raise."""
    return PydanticCustomError(IN_WORDS, "{in_words}", {IN_WORDS: problem})
