"""Computes the law over position, which the page draws behind the curves of a run."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from haptic_wall.controller.laws.wall import NONE
from haptic_wall.controller.settings.config import Config

POINTS: Final = 401
"""Positions at which the law is drawn"""
MARGIN: Final = 0.5
"""Margin on each side of the range of motion, as a fraction of it [1]"""
LEAST_RAD: Final = 0.05
"""Least range that is drawn around the motion [rad]"""


def law_over_position(
    config: Config, started_at: float, stiffness: float, low: float, high: float
) -> dict[str, Any]:
    """Return the spring's torque over position, at rest.

    Args:
        config: Present configuration.
        started_at: The first position of the run [rad].
        stiffness: Commanded [N·m/rad].
        low: Least position that must be drawn [rad].
        high: Largest one [rad].

    Returns:
        ``low`` and ``high`` of the drawn range [rad], ``torque`` at equally spaced positions from
        one to the other [N·m], ``surface`` [rad], the zero of the law's positions, ``edges`` [rad],
        the positions to keep in view, and ``name``.
    """
    law = config.law(0.0)
    law.position = config.surface(started_at)
    wall = config.wall
    law.stiffness = 0.0 if wall.law == NONE else stiffness
    ends = (wall.low or 0.0, wall.high or 0.0) if wall.law == "stops" else (0.0,)
    edges = [law.position + end for end in ends]
    low, high = min(low, *edges), max(high, *edges)
    room = max(MARGIN * (high - low), LEAST_RAD)
    low, high = low - room, high + room
    places = np.linspace(low, high, POINTS).tolist()
    law.settle(places[0])
    torque = [law.torque(place, 0.0) if law.in_contact(place) else 0.0 for place in places]
    return {
        "name": wall.law,
        "edges": edges,
        "low": low,
        "high": high,
        "torque": [float(f"{each:.7g}") if math.isfinite(each) else 0.0 for each in torque],
        "surface": law.position,
    }
