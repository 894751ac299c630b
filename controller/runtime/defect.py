"""An error that nobody foresaw, told so that it can be reported."""

from __future__ import annotations

import traceback
from pathlib import Path


def defect_text(error: Exception) -> str:
    """Name an error, and the function, file and line in which it was raised.

    Reads no source file: the torque may still be on.

    Args:
        error: As it was caught.
    """
    *_, (frame, line) = traceback.walk_tb(error.__traceback__)
    code = frame.f_code
    file = Path(code.co_filename).name
    return f"{type(error).__name__}: {error} (in {code.co_name}, {file} line {line})"
