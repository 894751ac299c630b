"""How large a kick can be and still ask whether motion grows, where the torque is limited."""

from __future__ import annotations

import numpy as np

from haptic_wall.controller.experiments.maps.many_walls import Walls
from haptic_wall.controller.theory.checks import FloatArray

_SHARE = 0.5
"""Of the torque limit, commanded by the spring alone: its damper needs some too."""
_COUNTS = 4.0
"""A smaller motion is not seen by the encoder for what it is."""


def unsaturated(walls: Walls, kick: FloatArray) -> FloatArray:
    """The kick, or where the spring would saturate, the largest at which it does not.

    A torque limit makes a wall softer to large motion, so that such motion comes down to where the
    limit hardly matters; whether it grows from there is the question. Not below four counts of the
    encoder and the backlash, whatever saturates.

    Args:
        walls: With stiffness > 0; shape (n,).
        kick: Asked for, shape (n,) [rad].
    """
    counts = walls.counts_per_radian
    seen = _COUNTS * np.where(counts > 0.0, 1.0 / np.where(counts > 0.0, counts, 1.0), 0.0)
    least = np.maximum(_SHARE * walls.torque_limit / walls.stiffness, seen + walls.backlash)
    return np.minimum(kick, least)
