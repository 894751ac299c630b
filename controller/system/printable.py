"""Makes text of any origin safe to print: writes control characters as escapes."""

from __future__ import annotations

import re

_MOST = 200
"""Longest displayed part of a name [characters]"""
# Control characters, direction marks, lone surrogates, invisible tags.
_OBEYED = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff"
    "\ud800-\udfff\U000e0000-\U000e007f]"
)


def printable(text: str) -> str:
    """Return the text with every control character but tab and line end written as an escape.

    A name from a file can then neither move the cursor nor change colours or the direction of
    writing.
    """
    return _OBEYED.sub(_escaped, text)


def in_line(text: str, most: int = _MOST) -> str:
    """Return the text as a part of one line: line ends become escapes, long text is truncated.

    Args:
        text: Of any length.
        most: Largest number of characters.
    """
    cut = text if len(text) <= most else f"{text[:most]}..."
    return printable(cut).replace("\n", "\\n")


def _escaped(found: re.Match[str]) -> str:
    return found[0].encode("unicode_escape").decode("ascii")
