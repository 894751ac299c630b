"""Whether rows can be a loop's: all there is to go by in a log without checksums."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from controller.detector.oscillation import State
from controller.telemetry import FLAG_CONTACT, FLAG_OFF, FLAG_SATURATED, FLAG_WARM_UP, ROW
from hw.servo import Outcome

_COLUMNS: Final = frozenset(ROW.names or ())
_GROW: Final = ("seq", "deadline_ns")
_MOST: Final = {
    "outcome": max(Outcome),
    "oscillation": max(State),
    "flags": FLAG_SATURATED | FLAG_CONTACT | FLAG_WARM_UP | FLAG_OFF,
    "phase": 1 << 20,
    "missed": 1 << 40,
}
_LONGEST_NS: Final = 1 << 50
"""No time within a tick is longer: some thirteen days"""
_LARGEST: Final = 1e12
"""Nor is any other number larger, in SI units"""


def plausible(rows: NDArray[Any]) -> bool:
    """Whether a block of rows, shape (n,), can be a loop's; columns of today may be missing."""
    names = rows.dtype.names or ()
    if not set(names) <= _COLUMNS:
        return False
    fits: tuple[NDArray[np.bool_], ...]
    for name in names:
        values = rows[name]
        if name in _GROW:
            fits = values[:1] >= 0, values[1:] > values[:-1]
        elif name in _MOST:
            fits = values >= 0, values <= _MOST[name]
        elif values.dtype.kind == "i":
            fits = values > -_LONGEST_NS, np.logical_or(values < _LONGEST_NS, name == "sampled_ns")
        elif values.dtype.kind == "f":
            fits = (~(np.abs(values) > _LARGEST),)  # NaN is what is not known
        else:
            continue
        if not all(bool(np.all(each)) for each in fits):
            return False
    return True
