"""Passive loads on a device: networks of masses, springs and dampers, and the poles with them.

Units: period 1. Nothing here uses ``haptic_wall``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]


class Wall(NamedTuple):
    """A device's damping, and the wall on it."""

    damping: float
    stiffness: float
    virtual_damping: float
    delay: float


class Load(NamedTuple):
    """Bodies, the first of which is the device, and what joins them to each other and the ground.

    ``springs`` and ``dampers`` are symmetric with the ground on the diagonal; none negative.
    """

    masses: Array
    springs: Array
    dampers: Array


def joined(links: Array) -> Array:
    """Force per displacement (or speed) of links between bodies."""
    between = links - np.diag(np.diag(links))
    result: Array = np.diag(between.sum(axis=1) + np.diag(links)) - between
    return result


def radius(wall: Wall, load: Load) -> float:
    """Largest magnitude of a pole of the sampled loop with the load; stable below 1."""
    n = load.masses.size
    viscous = joined(load.dampers)
    viscous[0, 0] += wall.damping
    a = np.zeros((2 * n + 1, 2 * n + 1))
    a[:n, n : 2 * n] = np.eye(n)
    a[n : 2 * n, :n] = -joined(load.springs) / load.masses[:, None]
    a[n : 2 * n, n : 2 * n] = -viscous / load.masses[:, None]
    a[n, 2 * n] = 1 / load.masses[0]
    whole = int(wall.delay)
    first, rest = expm(a * (wall.delay - whole)), expm(a * (1 - wall.delay + whole))
    move = slice(0, 2 * n)
    size = 2 * n + whole + 2  # bodies, torques commanded in the periods before, last position
    loop = np.zeros((size, size))
    command = np.zeros(size)
    command[0] = -wall.stiffness - wall.virtual_damping
    command[-1] = wall.virtual_damping

    def torque(periods_ago: int) -> Array:
        unit = np.zeros(size)
        unit[2 * n + periods_ago - 1] = 1.0
        return command if periods_ago == 0 else unit

    loop[move, move] = rest[move, move] @ first[move, move]
    loop[move] += np.outer(rest[move, move] @ first[move, -1], torque(whole + 1))
    loop[move] += np.outer(rest[move, -1], torque(whole))
    loop[2 * n] = command
    for i in range(1, whole + 1):
        loop[2 * n + i, 2 * n + i - 1] = 1.0
    loop[-1] = 0.0
    loop[-1, 0] = 1.0
    return float(np.max(np.abs(np.linalg.eigvals(loop))))


def random_load(random: np.random.Generator) -> Load:
    """One to five bodies, joined at random."""
    n = int(random.integers(1, 6))
    masses = 10 ** random.uniform(-2, 2, n)

    def links(share: float, low: float, high: float) -> Array:
        drawn = 10 ** random.uniform(low, high, (n, n)) * (random.random((n, n)) < share)
        upper = np.triu(drawn)
        return upper + np.triu(upper, 1).T

    return Load(masses, links(0.6, -3, 1.5), links(0.2, -3, 0.5))


def aliases(wall: Wall, theta: float, count: int) -> tuple[Array, NDArray[np.complex128]]:
    """Frequencies at which a torque held at ``theta`` acts, and what each adds to the loop.

    The loop is the sum of the weights, each times the admittance at its frequency.
    """
    w = np.asarray(theta + 2 * np.pi * np.arange(-count, count + 1), np.float64)
    h = wall.stiffness + wall.virtual_damping * (1 - np.exp(-1j * theta))
    return w, -h * (1 - np.exp(-1j * theta)) * np.exp(-1j * w * wall.delay) / w**2


def adverse_load(wall: Wall, theta: float, modes: int, detuning: float, mass: float) -> Load:
    """The load that brings the loop nearest to -1 at ``theta``.

    With any reactance the admittance 1 / (b + j X) is on a circle, so at each alias there is one
    reactance that is worst. A small mass on a soft spring, tuned beside an alias, gives it there
    and hardly anything elsewhere.
    """
    w, weight = aliases(wall, theta, 200)
    turn = 1 + weight.sum() / (2 * wall.damping)
    worst = -wall.damping / np.tan(np.angle(weight * np.conj(turn / np.abs(turn))) / 2)
    chosen = np.argsort(np.abs(w))[:modes]
    masses, springs = [mass], [0.0]
    for at, x in zip(np.abs(w[chosen]), (worst * np.sign(w))[chosen], strict=True):
        missing = x - mass * at
        tuned = at * (1 + detuning if missing > 0 else 1 - detuning)
        spring = missing * (tuned**2 - at**2) / at
        masses.append(spring / tuned**2)
        springs.append(spring)
    links = np.zeros((modes + 1, modes + 1))
    links[0, 1:] = links[1:, 0] = springs[1:]
    return Load(np.array(masses), links, np.zeros_like(links))


def distance(wall: Wall, theta: Array) -> Array:
    """How far the loop stays from -1 at each angle, whatever passive load there is."""
    result = []
    for x in theta.tolist():
        _, weight = aliases(wall, x, 200)
        result.append(
            np.abs(1 + weight.sum() / (2 * wall.damping))
            - np.abs(weight).sum() / (2 * wall.damping)
        )
    return np.array(result)
