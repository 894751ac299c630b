"""The plants to evaluate: the least safe corner of the belief, and members of its whole box.

The damping ceiling and the linear limit are least at one corner: lowest inertia and damping,
longest delay and period, highest torque gain. The other limits may be lower elsewhere. More inertia
lowers the exact limit a little where there is little damping. Inertia, gain and delay change the
phases at which a one-sided wall meets the device. A device with much viscous damping enters faster
than it moves at the wall, so that more damping lowers the one-sided limit. A wall may lose its
passivity at a shorter delay. These limits are therefore the least over members of the box.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.guard.belief import Belief
from haptic_wall.controller.guard.types import Request, Situation
from haptic_wall.controller.theory.checks import FloatArray

LIGHT = 0.1
"""Largest b T / m at which the least damping is the least safe; the table also ends there."""
_FEW = 4.0
"""Samples of the velocity up to which their number does not matter: a search found 0.97 of the
corner's exact limit with four, and half of it with 16"""
_INERTIAS: tuple[float, ...] = (1.0, 1.03, 1.07, 1.12, 1.2, 1.5)
_DAMPINGS = 8
_ON_BARE: tuple[float, ...] = (2.0, 2.8, 4.0, 5.0, 6.5, 8.0, 10.0, 13.0, 17.0, 22.0)
_MOST_ON_BARE = 31.0
"""Inertias that links of an arm may add up to, over the bare motor's; of heavier ones the linear
limit is the least. A dense search found 0.968 of the least of these (up to 16 samples, b T / m to
1) and 0.99 of the corner's where friction is light"""


@dataclass(frozen=True, slots=True)
class Plants:
    """Plants to evaluate, as arrays of one length."""

    inertia: FloatArray
    damping: FloatArray
    gain: FloatArray
    period: FloatArray
    delay: FloatArray
    """Total [s]"""

    @classmethod
    def at_corner(cls, situation: Situation, before_device: FloatArray) -> Plants:
        """Return the corner of the belief where the ceiling and the linear limit are least.

        Args:
            situation: The belief and the period.
            before_device: Delay without the device's own lag [s].
        """
        one = np.ones_like(before_device)
        belief = situation.belief
        return cls(
            inertia=belief.inertia.low * one,
            damping=belief.damping.low * one,
            gain=belief.torque_gain.high * one,
            period=situation.period * one,
            delay=before_device + belief.delay.high,
        )


def members(corners: Plants, situation: Situation, request: Request) -> Plants:
    """Return the members of the belief's box to evaluate around each corner, which is the first.

    With light friction that is the corner alone: the least limit over the box lies so close below
    the corner's that a factor covers it (``limits.CORNER_ALONE``); a search at each start would
    take a second. With a filter of the velocity more inertia may be less safe: by 7 % with slow
    low-passes. All members have the corner's delay: over random boxes a shorter delay lowers only
    the passive limit.

    Args:
        corners: ``Plants.at_corner``, or changed ones.
        situation: The belief and the period.
        request: The wall: its velocity samples, and its filter.
    """
    belief = situation.belief
    spread = belief.inertia.high / belief.inertia.low
    inertias, more_damping, gains = np.ones(1), np.zeros(1), np.ones(1)
    if is_heavy(situation, request.velocity_samples):
        most = max(_MOST_ON_BARE if belief.bare else 1.0, spread)
        inertias = _within(_INERTIAS + _ON_BARE if belief.bare else _INERTIAS, most)
        more_damping = _more_damping(belief)
        gains = 1.0 / _within([1.0], belief.torque_gain.high / belief.torque_gain.low)
    elif request.velocity_filter is not None:
        inertias = _within(_INERTIAS, spread)
    grid = np.meshgrid(inertias, more_damping, gains, indexing="ij")
    inertia, damping, gain = (each.ravel() for each in grid)
    return Plants(
        inertia=np.outer(corners.inertia, inertia).ravel(),
        damping=np.add.outer(corners.damping, damping).ravel(),
        gain=np.outer(corners.gain, gain).ravel(),
        period=np.repeat(corners.period, inertia.size),
        delay=np.repeat(corners.delay, inertia.size),
    )


def _within(factors: Sequence[float], most: float) -> FloatArray:
    """Return the factors below ``most``, then ``most``."""
    return np.array([*(each for each in factors if each < most), most])


def _more_damping(belief: Belief) -> FloatArray:
    """Return by how much the damping of each member exceeds the lowest [N·m·s/rad]."""
    low, high = belief.damping.low, belief.damping.high
    if not low < high:
        return np.zeros(1)
    spread = np.geomspace(max(low, 1e-2 * high), high, _DAMPINGS) - low
    return np.unique(np.append(0.0, spread))


def is_heavy(situation: Situation, samples: int) -> bool:
    """Whether friction may be so strong that the least limit lies far inside of the box.

    More friction then lowers the one-sided limit. With a velocity over more than four samples more
    inertia lowers the exact limit too, and lighter friction is enough.
    """
    belief = situation.belief
    settles = belief.damping.high * situation.period * max(1.0, samples / _FEW)
    return settles > LIGHT * belief.inertia.low
