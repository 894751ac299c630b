"""Limits a kick so that the torque limit does not hide whether motion grows."""

from __future__ import annotations

import numpy as np

from haptic_wall.controller.experiments.maps.walls import Walls
from haptic_wall.controller.theory.checks import FloatArray

_SHARE = 0.5
"""Fraction of the torque limit for the spring alone: its damper needs some too."""
_COUNTS = 4.0
"""Smallest motion that the encoder resolves [counts]."""


def unsaturated(walls: Walls, kick: FloatArray) -> FloatArray:
    """Return the kick, or the largest one at which the spring does not saturate.

    A torque limit makes a wall softer to large motion, so that such motion decays to where the
    limit hardly matters; the question is whether it grows from there. The result is at least four
    counts of the encoder and the backlash.

    Args:
        walls: Walls with stiffness > 0; shape (n,).
        kick: Requested, shape (n,) [rad].
    """
    counts = walls.counts_per_radian
    seen = _COUNTS * np.where(counts > 0.0, 1.0 / np.where(counts > 0.0, counts, 1.0), 0.0)
    least = np.maximum(_SHARE * walls.torque_limit / walls.stiffness, seen + walls.backlash)
    return np.minimum(kick, least)
