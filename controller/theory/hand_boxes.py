"""Proves for a whole range of hands that no hand in it puts a pole on the unit circle.

At the angle ``theta`` the device with its hand responds at the aliases
``w_n = (theta + 2 pi n) / T`` with the admittances ``Y_n = 1 / (R + j X_n)``,
``X_n = M w_n - k / w_n``, and ::

    1 + L = 1 + sum_n C_n Y_n,    C_n = -H (1 - e^{-j theta}) e^{-j w_n t_d} / (T w_n²)

with ``H = K + (B / (N T)) (1 - e^{-j N theta})``. Over a range of hands each ``Y_n`` stays in a
region bounded by four arcs, whose least extent in any direction has a closed form. If in one
direction the sum of these extents cannot reach -1, no hand of the range has ``1 + L = 0`` at that
angle. The proof covers a whole cell of angles: the range of ``X_n`` is taken over the cell, and
``C_n`` with its largest change.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.theory.arcs import least_reach
from haptic_wall.controller.theory.checks import ComplexArray, FloatArray

_NEAR = np.array([0, -1, 1])  # aliases with their exact region
_FAR = np.array([n for n in range(-24, 25) if abs(n) > 1])  # aliases with a bound only
_DIRECTIONS = np.exp(2j * np.pi * np.arange(32) / 32)
_ANGLES = 160
_CELL_HALVINGS = 8


class Box(NamedTuple):
    """Ranges of mass, damping and spring of device and hand together, as (lowest, highest)."""

    mass: tuple[float, float]
    """> 0 [kg·m²]"""
    damping: tuple[float, float]
    """> 0 [N·m·s/rad]"""
    spring: tuple[float, float]
    """[N·m/rad]"""


class HeldWall(NamedTuple):
    """A two-sided wall and its device, in SI units."""

    inertia: float
    damping: float
    stiffness: float
    virtual_damping: float
    period: float
    delay: float
    samples: int


def doubt(wall: HeldWall, box: Box) -> float | None:
    """Return the frequency [rad/s] at which some hand of the box comes nearest to 1 + L = 0.

    Returns None if it is proved that no hand reaches 1 + L = 0 at any angle. Cells of angles in
    which the proof fails are halved, unless the width of the box is the reason.

    Args:
        wall: The wall.
        box: Device and hand.
    """
    theta, half_cell = _angles(wall, box)
    worst = 0
    for _ in range(_CELL_HALVINGS):
        left = _clear(wall, box, theta, half_cell) <= 0
        if not np.any(left):
            return None
        theta, half_cell = theta[left], half_cell[left]
        clear = _clear(wall, box, theta, 0.0 * half_cell)
        worst = int(np.argmin(clear))
        if clear[worst] <= 0:
            break
        half_cell = np.tile(0.5 * half_cell, 2)
        theta = np.tile(theta, 2) + half_cell * np.repeat([-1.0, 1.0], theta.size)
    return float(theta[worst]) / wall.period


def _clear(wall: HeldWall, box: Box, theta: FloatArray, half_cell: FloatArray) -> FloatArray:
    """Return a lower bound of abs(1 + L) over the hands of the box, for each cell of angles.

    Args:
        wall: The wall.
        box: Device and hand.
        theta: Middles of the cells.
        half_cell: Halves of their widths.
    """
    at, width = theta[:, None] / wall.period, half_cell[:, None] / wall.period
    r, turns = box.damping, 2 * np.pi / wall.period
    near, far = at + turns * _NEAR, at + turns * _FAR
    low, high = _reactance(box, near, width)
    weights, change = _weights(wall, near, width)
    # least extents, in every direction: angles × aliases × directions
    extent = least_reach(
        weights[:, :, None] * np.conj(_DIRECTIONS), r, low[:, :, None], high[:, :, None]
    ).sum(axis=1)
    rest = (change * _most_admittance(r, low, high)).sum(axis=1)
    low, high = _reactance(box, far, width)
    weights, change = _weights(wall, far, width)
    size, most = np.abs(weights) + change, _most_admittance(r, low, high)
    rest += (size * most).sum(axis=1)
    # beyond the last alias the weights fall with its square: their sum is below n × the last. Where
    # the mass outweighs the spring, the admittances fall too.
    by_mass = np.stack([high[:, 0] < 0, low[:, -1] > 0], axis=1)
    most = np.where(by_mass, most[:, [0, -1]], 1 / r[0])
    rest += (_FAR.max() + 1) * (size[:, [0, -1]] * most).sum(axis=1)
    clear: FloatArray = np.max(np.real(_DIRECTIONS) + extent - rest[:, None], axis=1)
    return clear


def _angles(wall: HeldWall, box: Box) -> tuple[FloatArray, FloatArray]:
    """Return angles around the circle, and half the cell of each.

    They start at the lowest of three angles: a tenth of the frequency of the greatest mass on the
    wall's own spring; where the wall's torque lags by half a radian; where the damper's delayed
    part approaches the spring. Below it the springs dominate, and the loop cannot oscillate.
    """
    late = wall.delay + wall.samples * wall.period
    w = min(0.1 * math.sqrt(wall.stiffness / box.mass[1]), 0.5 / late)
    if wall.virtual_damping != 0:
        w = min(w, 0.3 * math.sqrt(wall.stiffness / abs(wall.virtual_damping) / late))
    start = min(wall.period * w, 0.5)
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


def _weights(wall: HeldWall, w: FloatArray, width: FloatArray) -> tuple[ComplexArray, FloatArray]:
    """Return C_n at the aliases ``w`` (angles × aliases), its largest change within ``width``."""
    n = wall.samples
    theta = w * wall.period
    h = wall.stiffness + wall.virtual_damping / (n * wall.period) * (1 - np.exp(-1j * n * theta))
    held = (1 - np.exp(-1j * theta)) / wall.period
    weights: ComplexArray = -h * held * np.exp(-1j * w * wall.delay) / w**2
    slow = _slowest(w, width)
    most = (np.abs(h) + abs(wall.virtual_damping) * width) * (np.abs(held) + width) / slow**2
    return weights, most * (1 + wall.delay * width) - np.abs(weights)


def _slowest(w: FloatArray, width: FloatArray) -> FloatArray:
    """Return the least abs(w) within ``width``; cells do not include 0."""
    return np.maximum(np.abs(w) - width, 1e-3 * np.abs(w))


def _most_admittance(r: tuple[float, float], low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the greatest abs(1 / (R + jX)) over ranges of R and X."""
    nearest = np.where((low > 0) | (high < 0), np.minimum(np.abs(low), np.abs(high)), 0.0)
    most: FloatArray = 1 / np.hypot(r[0], nearest)
    return most


def _reactance(box: Box, w: FloatArray, width: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the range of M w - k/w over the box and over w ± width (of one sign)."""
    slow, fast = _slowest(w, width), np.abs(w) + width
    low = box.mass[0] * slow - box.spring[1] / slow
    high = box.mass[1] * fast - box.spring[0] / fast
    return np.where(w > 0, low, -high), np.where(w > 0, high, -low)
