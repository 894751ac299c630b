"""Text in lines as wide as the terminal; what is there to be copied stays in one piece."""

from __future__ import annotations

import re
import shutil
import textwrap

_WIDTH = 98
"""Where nobody says how wide it is"""
_NARROWEST = 40
_COMMAND = re.compile(r"`[^`\n]+`")
_BLANK = "\N{NO-BREAK SPACE}"
"""Which ``textwrap`` takes for a letter"""


def width() -> int:
    """Characters in a line: what ``COLUMNS`` says, else the terminal."""
    return max(_NARROWEST, shutil.get_terminal_size((_WIDTH, 24)).columns)


def wrapped(text: str, first: str = "", other: str = "") -> list[str]:
    """Lines of that width; no path and no command between backticks is broken.

    Args:
        text: Any; its line breaks are blanks.
        first: What the first line begins with.
        other: What the others begin with.
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
