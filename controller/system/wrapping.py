"""Wraps text to the terminal's width; keeps paths and commands in one piece for copying."""

from __future__ import annotations

import re
import shutil
import textwrap

_WIDTH = 98
"""Width where it is unknown"""
_NARROWEST = 40
_COMMAND = re.compile(r"`[^`\n]+`")
_BLANK = "\N{NO-BREAK SPACE}"
"""A space that ``textwrap`` takes for a letter"""


def width() -> int:
    """Return the characters in a line: from ``COLUMNS``, else from the terminal."""
    return max(_NARROWEST, shutil.get_terminal_size((_WIDTH, 24)).columns)


def wrapped(text: str, first: str = "", other: str = "") -> list[str]:
    """Return lines of that width; no path and no command between backticks is broken.

    Args:
        text: Any; its line breaks become spaces.
        first: Beginning of the first line.
        other: Beginning of the others.
    """
    whole = _COMMAND.sub(lambda found: found.group().replace(" ", _BLANK), text)
    lines = textwrap.wrap(
        whole,
        width(),
        initial_indent=first,
        subsequent_indent=other,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace(_BLANK, " ") for line in lines]
