"""Suggests a known name for one that is unknown."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def did_you_mean(found: str, known: Iterable[str], prefix: str = "") -> str:
    """Return a question that suggests the nearest known name for an unknown one.

    Args:
        found: The unknown name.
        known: The names to choose from.
        prefix: Stands before the suggested name.

    Returns:
        ``did you mean NAME?``, or nothing where no known name is alike.
    """
    near = difflib.get_close_matches(found, list(known), n=1)
    return f"did you mean {prefix}{near[0]}?" if near else ""
