"""Reads strict JSON: Python's own reader accepts NaN and turns 1e400 into infinity."""

from __future__ import annotations

import json
import math
from typing import Any, Final

from haptic_wall import __version__

RESULT_MARK: Final = {"program": f"haptic-wall {__version__}"}
"""First entry of every result's JSON"""


def parse(text: bytes) -> Any:  # noqa: ANN401 - whatever the text holds
    """Return the value of a JSON text.

    Raises:
        ValueError: It is no JSON.
        RecursionError: It is nested too deeply.
    """
    return json.loads(text, parse_constant=_finite, parse_float=_finite)


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text} is no number in JSON")
    return number
