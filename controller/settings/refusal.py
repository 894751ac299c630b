"""Makes a validator's error from a finished message, with found and wanted values."""

from __future__ import annotations

from pydantic_core import PydanticCustomError

from haptic_wall.hw.errors import Problem

IN_WORDS = "in_words"
"""Kind of such an error, and where its context holds the problem"""


def refusal(problem: Problem) -> PydanticCustomError:
    """Return the error for a validator to raise."""
    return PydanticCustomError(IN_WORDS, "{in_words}", {IN_WORDS: problem})
