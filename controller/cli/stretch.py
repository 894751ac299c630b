"""Defines the options ``--from`` and ``--to``, which choose a stretch of a log."""

from __future__ import annotations

import math

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.reader import TimeSpan


def stretch_between(start_s: float | None, end_s: float | None) -> TimeSpan:
    """Return the stretch that ``--from`` and ``--to`` choose.

    Raises:
        UserError: The stretch is empty, or not in seconds from 0 up.
    """
    for option, value in (("--from", start_s), ("--to", end_s)):
        if value is not None and not 0.0 <= value < math.inf:
            raise UserError(
                f"found {value:g}",
                field=option,
                wanted="seconds since the log's first row, from 0 up",
            )
    if start_s is not None and end_s is not None and start_s >= end_s:
        raise UserError(
            f"found {end_s:g}", field="--to", wanted=f"more than --from, which is {start_s:g}"
        )
    return TimeSpan(-math.inf if start_s is None else start_s, math.inf if end_s is None else end_s)
