"""Decides whether a wall is stable with all hands in a range of mass, damping and stiffness.

Suppose that the loop is stable with one hand, and that no hand of a range puts a pole on the unit
circle (module ``hand_boxes``): then it is stable with all hands of the range. Where this cannot be
shown, the range is halved, until it is shown or an unstable hand is found. The condition of
``passivity`` is tried first, because a passive wall is stable with every hand.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.theory.checks import (
    FloatArray,
    not_negative,
    number,
    positive,
    samples,
    scalar,
)
from haptic_wall.controller.theory.coupled import Hand, coupled_limit, is_stable
from haptic_wall.controller.theory.hand_boxes import Box, HeldWall, doubt
from haptic_wall.controller.theory.passivity import passive_limit

_REFINEMENTS = 12


@dataclass(frozen=True, slots=True)
class HandRange:
    """Range of hands: lowest and highest value of each property; see ``Hand``."""

    mass: tuple[float, float] = (0.0, 0.0)
    """[kg·m²]"""
    damping: tuple[float, float] = (0.0, 0.0)
    """[N·m·s/rad]"""
    stiffness: tuple[float, float] = (0.0, 0.0)
    """[N·m/rad]"""


@dataclass(frozen=True, slots=True)
class HandVerdict:
    """Verdict on a wall with the hands of a range."""

    stable: bool | None
    """True: shown for every hand; False: ``worst`` makes it unstable; None: neither was shown"""
    worst: Hand
    """The hand with the lowest critical stiffness found"""
    limit: float
    """That critical stiffness [N·m/rad]"""


def stable_hands(
    inertia: float,
    damping: float,
    stiffness: float,
    virtual_damping: float,
    period: float,
    delay: float,
    hands: HandRange,
    velocity_samples: int = 1,
    effort: int = 300,
) -> HandVerdict:
    """Decide whether a two-sided wall is stable with every linear hand of a range; find the worst.

    ``stable=True`` is proved for all hands of the range. ``stable=False`` is proved by the poles
    with the hand ``worst``.

    Args:
        inertia: m > 0 of the device [kg·m²].
        damping: Viscous damping b > 0 of the device [N·m·s/rad].
        stiffness: K > 0 [N·m/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        hands: The range of hands.
        velocity_samples: N of the velocity difference, >= 1.
        effort: Number of parts of the range to evaluate before giving up, 10 ms each.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    wall = HeldWall(
        scalar(positive, "inertia", inertia),
        scalar(positive, "damping", damping),
        scalar(positive, "stiffness", stiffness),
        scalar(number, "virtual_damping", virtual_damping),
        scalar(positive, "period", period),
        scalar(not_negative, "delay", delay),
        int(scalar(samples, "velocity_samples", velocity_samples)),
    )
    effort = int(scalar(samples, "effort", effort))
    for name in ("mass", "damping", "stiffness"):
        bounds = not_negative(f"hands.{name}", getattr(hands, name))
        if bounds.shape != (2,):
            raise ValueError(f"hands.{name} must be a pair (low, high), got {bounds.tolist()}")
        low, high = bounds.tolist()
        if low > high:
            raise ValueError(f"hands.{name} must not fall, got {low:g} to {high:g}")
    # device and hand together, so that no mass and no damping of the range is 0
    box = Box(
        (wall.inertia + hands.mass[0], wall.inertia + hands.mass[1]),
        (wall.damping + hands.damping[0], wall.damping + hands.damping[1]),
        (float(hands.stiffness[0]), float(hands.stiffness[1])),
    )
    worst, limit = _worst(wall, box)
    if not is_stable(*wall[:6], worst, wall.samples):
        return HandVerdict(False, worst, limit)
    passive = passive_limit(box.damping[0], virtual_damping, period, delay, velocity_samples)
    if stiffness < passive:
        return HandVerdict(True, worst, limit)
    waiting = deque([box])
    for _ in range(effort):
        part = waiting.popleft()
        doubtful = doubt(wall, part)
        if doubtful is not None:
            hand = _hand(wall, *(_middle(wall, part)))
            if not is_stable(*wall[:6], hand, wall.samples):
                return HandVerdict(False, hand, _limit(wall, hand))
            halves = _halves(wall, part, doubtful)
            if halves is None:
                return HandVerdict(None, worst, limit)
            waiting.extend(halves)
        if not waiting:
            return HandVerdict(True, worst, limit)
    return HandVerdict(None, worst, limit)


def _hand(wall: HeldWall, mass: float, damping: float, spring: float) -> Hand:
    return Hand(
        max(float(mass) - wall.inertia, 0.0), max(float(damping) - wall.damping, 0.0), float(spring)
    )


def _limit(wall: HeldWall, hand: Hand) -> float:
    _, _, _, big_b, period, delay, n_samples = wall
    limit = coupled_limit(
        wall.inertia, wall.damping, big_b, period, delay, hand, velocity_samples=n_samples
    )
    return float(limit)


def _at(wall: HeldWall, box: Box, share: FloatArray) -> tuple[float, float, float]:
    """Return mass, damping and spring at fractions (0 to 1) of a box, on a geometric scale."""
    (m0, m1), (b0, b1), (k0, k1) = box
    x0, x1 = math.asinh(k0 / wall.stiffness), math.asinh(k1 / wall.stiffness)
    return (
        min(m1, m0 * (m1 / m0) ** share[0]),
        min(b1, b0 * (b1 / b0) ** share[1]),
        min(max(wall.stiffness * math.sinh(x0 + (x1 - x0) * share[2]), k0), k1),
    )


def _middle(wall: HeldWall, box: Box) -> tuple[float, float, float]:
    return _at(wall, box, np.full(3, 0.5))


def _halves(wall: HeldWall, box: Box, w: float) -> tuple[Box, Box] | None:
    """Halve the box along the side that varies the impedance most at frequency ``w``."""
    (m0, m1), (b0, b1), (k0, k1) = box
    spread = ((m1 - m0) * w, b1 - b0, (k1 - k0) / w)
    widest = int(np.argmax(spread))
    if spread[widest] <= 1e-9 * b0:
        return None
    cut = _middle(wall, box)[widest]
    first, second = list(box), list(box)
    first[widest], second[widest] = (box[widest][0], cut), (cut, box[widest][1])
    return Box(*first), Box(*second)


def _worst(wall: HeldWall, box: Box) -> tuple[Hand, float]:
    """Find the lowest critical stiffness on a grid over the box, then around the lowest point."""
    found: dict[tuple[float, float, float], float] = {}

    def limit(share: FloatArray) -> float:
        at = _at(wall, box, share)
        if at not in found:
            found[at] = _limit(wall, _hand(wall, *at))
        return found[at]

    grid = [
        np.array([x, y, z])
        for x in np.linspace(0, 1, 4)
        for y in (0.0, 1.0)
        for z in np.linspace(0, 1, 9)
    ]
    best = min(grid, key=limit)
    stride = np.array([1 / 6, 0.5, 1 / 16])
    for _ in range(_REFINEMENTS):
        around = [
            np.clip(best + sign * stride * axis, 0, 1) for axis in np.eye(3) for sign in (-1, 1)
        ]
        best = min([best, *around], key=limit)
        stride = 0.6 * stride
    return _hand(wall, *_at(wall, box, best)), limit(best)
