"""Reads and makes strict JSON: Python's own accepts NaN, and turns 1e400 into infinity."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import PurePath
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


def plain(value: Any) -> Any:  # noqa: ANN401 - any report's parts
    """Return a value as JSON can hold it; numbers that are not finite become null.

    Args:
        value: Made of mappings, sequences, numbers (NumPy's too), texts and paths.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(inner) for inner in value]
    if isinstance(value, PurePath):
        return str(value)
    if hasattr(value, "tolist"):  # NumPy's scalars and arrays
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
