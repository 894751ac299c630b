"""Text of anybody's as it may be shown: what a terminal would obey is written as an escape."""

from __future__ import annotations

import re

_MOST = 200
"""Characters of a name that are shown"""
# Control characters, what turns the direction of writing, lone surrogates, tags that nobody sees.
_OBEYED = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff"
    "\ud800-\udfff\U000e0000-\U000e007f]"
)


def printable(text: str) -> str:
    """The text with every control character but tab and line end written as an escape.

    So a name out of a file can neither move the cursor nor change colours, nor turn the direction
    of writing.
    """
    return _OBEYED.sub(_escaped, text)


def in_line(text: str, most: int = _MOST) -> str:
    """The text as a part of one line: a line end is an escape too, and a long text is cut off.

    Args:
        text: Of any length.
        most: Characters that are shown.
    """
    cut = text if len(text) <= most else f"{text[:most]}..."
    return printable(cut).replace("\n", "\\n")


def _escaped(found: re.Match[str]) -> str:
    return found[0].encode("unicode_escape").decode("ascii")
