"""Which hands a wall stays stable with: a verdict over ranges of mass, damping and spring.

A loop that is stable with one hand is stable with all the hands of a range if none of them puts a
pole on the unit circle. At the angle ``theta`` the device with its hand answers at the aliases
``w_n = (theta + 2 pi n) / T`` with the admittances ``Y_n = 1 / (R + j X_n)``,
``X_n = M w_n - k / w_n``, and ::

    1 + L = 1 + sum_n C_n Y_n,    C_n = -H (1 - e^{-j theta}) e^{-j w_n t_d} / (T w_n²)

with ``H = K + (B / (N T)) (1 - e^{-j N theta})``. Over a range of hands each ``Y_n`` stays in a
region bounded by four arcs, whose least extent in any direction has a closed form. If in one
direction these extents add up to less than what reaches 0, no hand of the range has ``1 + L = 0``
at that angle. Where that fails the range is halved, until it is shown or a hand is found that is
unstable. With R free upwards and X free altogether this is the condition of ``passivity``, which is
tried first: so a passive wall is shown stable with every hand at once.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.theory.arcs import least_reach
from controller.theory.checks import FloatArray, not_negative, number, positive, samples
from controller.theory.coupled import Hand, coupled_limit, is_stable
from controller.theory.passivity import passive_limit

ComplexArray = NDArray[np.complex128]

_NEAR = np.array([0, -1, 1])  # aliases of which the region is taken as it is
_FAR = np.array([n for n in range(-24, 25) if abs(n) > 1])  # those that are only bounded
_DIRECTIONS = np.exp(2j * np.pi * np.arange(32) / 32)
_ANGLES = 160
_REFINEMENTS = 12


@dataclass(frozen=True, slots=True)
class HandRange:
    """Hands from the least to the most of each property; see ``Hand``."""

    mass: tuple[float, float] = (0.0, 0.0)
    """[kg·m²]"""
    damping: tuple[float, float] = (0.0, 0.0)
    """[N·m·s/rad]"""
    stiffness: tuple[float, float] = (0.0, 0.0)
    """[N·m/rad]"""


@dataclass(frozen=True, slots=True)
class HandVerdict:
    """What is known of a wall with the hands of a range."""

    stable: bool | None
    """True: shown for every hand; False: ``worst`` makes it unstable; None: neither was managed"""
    worst: Hand
    """The hand with the lowest critical stiffness found"""
    limit: float
    """That critical stiffness [N·m/rad]"""


class _Box(NamedTuple):
    """A range of device and hand together."""

    mass: tuple[float, float]
    damping: tuple[float, float]
    spring: tuple[float, float]


class _Wall(NamedTuple):
    inertia: float
    damping: float
    stiffness: float
    virtual_damping: float
    period: float
    delay: float
    samples: int


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
    """Whether a two-sided wall is stable with every linear hand of a range, and the worst of them.

    ``stable=True`` is shown for all the hands of the range at once, at each of several hundred
    angles around the unit circle (reactances are taken over the whole cell around each angle, so
    that no resonance falls between two of them; the smooth rest is not). ``stable=False`` is shown
    by the poles with the hand named.

    Args:
        inertia: m > 0 of the device [kg·m²].
        damping: Viscous damping b > 0 of the device [N·m·s/rad].
        stiffness: K > 0 [N·m/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        hands: The hands that are asked about.
        velocity_samples: N of the velocity difference, >= 1.
        effort: How many parts of the range are looked at before it is given up, 5 ms for each.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    wall = _Wall(
        float(positive("inertia", inertia)),
        float(positive("damping", damping)),
        float(positive("stiffness", stiffness)),
        float(number("virtual_damping", virtual_damping)),
        float(positive("period", period)),
        float(not_negative("delay", delay)),
        int(samples("velocity_samples", velocity_samples)),
    )
    effort = int(samples("effort", effort))
    for name in ("mass", "damping", "stiffness"):
        low, high = not_negative(f"hands.{name}", getattr(hands, name))
        if low > high:
            raise ValueError(f"hands.{name} must not fall, got {low:g} to {high:g}")
    # device and hand together, so that no mass and no damping of the range is 0
    box = _Box(
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
        doubt = _doubt(wall, part)
        if doubt is not None:
            hand = _hand(wall, *(_middle(wall, part)))
            if not is_stable(*wall[:6], hand, wall.samples):
                return HandVerdict(False, hand, _limit(wall, hand))
            halves = _halves(wall, part, doubt)
            if halves is None:
                return HandVerdict(None, worst, limit)
            waiting.extend(halves)
        if not waiting:
            return HandVerdict(True, worst, limit)
    return HandVerdict(None, worst, limit)


def _hand(wall: _Wall, mass: float, damping: float, spring: float) -> Hand:
    return Hand(
        max(float(mass) - wall.inertia, 0.0), max(float(damping) - wall.damping, 0.0), float(spring)
    )


def _limit(wall: _Wall, hand: Hand) -> float:
    _, _, _, big_b, period, delay, n_samples = wall
    limit = coupled_limit(
        wall.inertia, wall.damping, big_b, period, delay, hand, velocity_samples=n_samples
    )
    return float(limit)


def _at(wall: _Wall, box: _Box, share: FloatArray) -> tuple[float, float, float]:
    """The hand at the shares (0 to 1) of the ranges: by ratio, the spring beside the wall's."""
    (m0, m1), (b0, b1), (k0, k1) = box
    x0, x1 = math.asinh(k0 / wall.stiffness), math.asinh(k1 / wall.stiffness)
    return (
        min(m1, m0 * (m1 / m0) ** share[0]),
        min(b1, b0 * (b1 / b0) ** share[1]),
        min(max(wall.stiffness * math.sinh(x0 + (x1 - x0) * share[2]), k0), k1),
    )


def _middle(wall: _Wall, box: _Box) -> tuple[float, float, float]:
    return _at(wall, box, np.full(3, 0.5))


def _halves(wall: _Wall, box: _Box, w: float) -> tuple[_Box, _Box] | None:
    """The box cut across the side that spreads the impedance most at ``w``; None for a point."""
    (m0, m1), (b0, b1), (k0, k1) = box
    spread = ((m1 - m0) * w, b1 - b0, (k1 - k0) / w)
    widest = int(np.argmax(spread))
    if spread[widest] <= 1e-9 * b0:
        return None
    cut = _middle(wall, box)[widest]
    first, second = list(box), list(box)
    first[widest], second[widest] = (box[widest][0], cut), (cut, box[widest][1])
    return _Box(*first), _Box(*second)


def _worst(wall: _Wall, box: _Box) -> tuple[Hand, float]:
    """The lowest critical stiffness on a grid over the box, and then around the lowest."""
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


def _doubt(wall: _Wall, box: _Box) -> float | None:
    """The frequency [rad/s] where some hand of the box comes nearest to 1 + L = 0.

    None where none can have it, at any of the angles.
    """
    theta, half_cell = _angles(wall, box)
    r = box.damping
    at, width = theta[:, None] / wall.period, half_cell[:, None] / wall.period
    turns = 2 * np.pi / wall.period
    near, far = at + turns * _NEAR, at + turns * _FAR
    low, high = _reactance(box, near, width)
    # what no hand can reach, in every direction: angles × aliases × directions
    extent = least_reach(
        _weights(wall, theta, near)[:, :, None] * np.conj(_DIRECTIONS),
        r,
        low[:, :, None],
        high[:, :, None],
    ).sum(axis=1)
    low, high = _reactance(box, far, width)
    nearest = np.where((low > 0) | (high < 0), np.minimum(np.abs(low), np.abs(high)), 0.0)
    bound = np.abs(_weights(wall, theta, far)) / np.hypot(r[0], nearest)
    # beyond the last alias the terms fall at least with its square: their sum is below n × the last
    rest = bound.sum(axis=1) + (_FAR.max() + 1) * (bound[:, 0] + bound[:, -1])
    reach = np.real(_DIRECTIONS) + extent - rest[:, None]
    clear = np.max(reach, axis=1)
    worst = int(np.argmin(clear))
    return None if clear[worst] > 0 else float(at[worst, 0])


def _angles(wall: _Wall, box: _Box) -> tuple[FloatArray, FloatArray]:
    """Angles around the circle, and half the cell of each.

    They start at a tenth of the frequency that the wall's own spring gives the greatest mass: below
    it the springs outweigh the mass, and the loop cannot oscillate.
    """
    start = 0.1 * wall.period * math.sqrt(wall.stiffness / box.mass[1])
    start = min(start, 0.5)
    even = np.pi / (_ANGLES + 24 * int(wall.delay / wall.period + wall.samples))
    count = max(2, int(math.log(1 / start) / 0.03))
    edges = np.concatenate([np.geomspace(start, 1.0, count), [np.pi]])
    steps = np.ceil(np.diff(edges) / even).astype(int)
    edges = np.concatenate(
        [
            np.linspace(a, b, n, endpoint=False)
            for a, b, n in zip(edges[:-1], edges[1:], steps, strict=True)
        ]
        + [np.array([np.pi])]
    )
    return 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)


def _weights(wall: _Wall, theta: FloatArray, w: FloatArray) -> ComplexArray:
    """C_n at the aliases ``w`` (angles × aliases)."""
    n = wall.samples
    h = wall.stiffness + wall.virtual_damping / (n * wall.period) * (1 - np.exp(-1j * n * theta))
    outer = -h * (1 - np.exp(-1j * theta)) / wall.period
    result: ComplexArray = outer[:, None] * np.exp(-1j * w * wall.delay) / w**2
    return result


def _reactance(box: _Box, w: FloatArray, width: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Range of M w - k/w over the box and over w - width to w + width (of one sign)."""
    size = np.abs(w)
    slow, fast = np.maximum(size - width, 1e-3 * size), size + width
    low = box.mass[0] * slow - box.spring[1] / slow
    high = box.mass[1] * fast - box.spring[0] / fast
    return np.where(w > 0, low, -high), np.where(w > 0, high, -low)
