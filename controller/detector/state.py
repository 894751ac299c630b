"""The states of an oscillation."""

from __future__ import annotations

from enum import IntEnum


class State(IntEnum):
    """State of the loop's own oscillation; the worse, the greater. A hand's motion is quiet."""

    QUIET = 0
    DECAYING = 1
    SUSTAINED = 2
    GROWING = 3
