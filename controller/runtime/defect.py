"""Describes an unexpected error so that a user can report it."""

from __future__ import annotations

import traceback
from pathlib import Path


def defect_text(error: Exception) -> str:
    """Name an error, and the function, file and line in which it was raised.

    It reads no source file: the torque may still be on.

    Args:
        error: The caught error.
    """
    *_, (frame, line) = traceback.walk_tb(error.__traceback__)
    code = frame.f_code
    file = Path(code.co_filename).name
    return f"{type(error).__name__}: {error} (in {code.co_name}, {file} line {line})"
