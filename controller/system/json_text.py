"""Reads strict JSON: Python's own reader accepts NaN and turns 1e400 into infinity."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from haptic_wall.controller.system.regular_file import content

MOST_BYTES = 1 << 24
"""Largest size of a file of results: the longest has some hundred thousand bytes"""


def parse(text: bytes) -> Any:  # noqa: ANN401 - whatever the text holds
    """Return the value of a JSON text.

    Raises:
        ValueError: It is no JSON.
        RecursionError: It is nested too deeply.
    """
    return json.loads(text, parse_constant=_finite, parse_float=_finite)


def held_in(path: Path) -> Any:  # noqa: ANN401 - whatever the file holds
    """Return the value in a JSON file.

    Raises:
        OSError: It cannot be read, is no regular file, or is longer than ``MOST_BYTES``.
        ValueError: It is no JSON.
        RecursionError: It is nested too deeply.
    """
    return parse(content(path, MOST_BYTES))


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text} is no number in JSON")
    return number
