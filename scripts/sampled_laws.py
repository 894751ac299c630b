"""Simulation in time of laws other than a wall, many at once, on servos without friction.

Nothing here uses ``haptic_wall``: what the guard commands is held against it. A servo moves exactly
under each held torque. All is in pure numbers: one period, an inertia of 1. Positions are in units
of a law's own length.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Kind = Literal["periodic", "bounded", "stops", "friction", "texture"]
QUARTERS = 4


@dataclass(frozen=True, slots=True)
class Servos:
    """Servos, and what is commanded; flat arrays of one length."""

    damping: Array
    """b T / m"""
    stiffness: Array
    """K T² / m, of a law's steepest slope"""
    virtual_damping: Array
    """B T / m"""
    delay: Array
    """t_d / T"""


@dataclass(frozen=True, slots=True)
class Found:
    """What became of each motion."""

    kinetic: Array
    """Largest kinetic energy in each quarter of the time, shape (4, n)"""
    energy: Array
    """Largest energy, kinetic and stored, in each quarter"""
    start: Array
    """Energy at the start"""


class Law:
    """The elongation of one kind of law for each servo.

    Args:
        kind: ``periodic``: a table over one unit, again and again; ``bounded``: a table over two
            units about zero, and constant beyond; ``stops``: walls at ±1 that never pull;
            ``friction``: a spring to an anchor that is dragged along at an elongation of 1;
            ``texture``: a sine of period 1 that fades.
        table: Elongations at equal distances, shape (n, j); for tables only.
    """

    def __init__(self, kind: Kind, count: int, table: Array | None = None) -> None:
        self.kind = kind
        self._rows = np.arange(count)
        self._anchor = np.full(count, np.nan)
        if table is None:
            return
        self._size = table.shape[1] if kind == "periodic" else table.shape[1] - 1
        width = 1.0 if kind == "periodic" else 2.0
        self._knot = width / self._size
        ends = np.concatenate([table, table[:, :1]], 1) if kind == "periodic" else table
        steps = 0.5 * (ends[:, 1:] + ends[:, :-1]) * self._knot
        potential = np.concatenate([np.zeros((count, 1)), np.cumsum(steps, 1)], 1)
        self._ends = ends
        self._potential = potential - potential.min(1, keepdims=True)

    def at(self, x: Array, speed: Array) -> tuple[Array, Array]:
        """Return elongation and potential."""
        if self.kind == "stops":
            e = x - np.clip(x, -1.0, 1.0)
            return e, 0.5 * e * e
        if self.kind == "friction":
            bent = np.where(np.isnan(self._anchor), 0.0, x - self._anchor)
            e = np.clip(bent, -1.0, 1.0)
            self._anchor = x - e
            return e, 0.5 * e * e
        if self.kind == "texture":
            wave = 2.0 * np.pi
            fade = np.clip(2.0 - 8.0 * np.abs(speed), 0.0, 1.0)
            return fade * np.sin(wave * x) / wave, (1.0 - np.cos(wave * x)) / wave**2
        place = (x - np.floor(x)) if self.kind == "periodic" else np.clip(x, -1.0, 1.0) + 1.0
        at = place / self._knot
        i = np.minimum(at.astype(np.intp), self._size - 1)
        low, high = self._ends[self._rows, i], self._ends[self._rows, i + 1]
        e = low + (high - low) * (at - i)
        u = self._potential[self._rows, i] + 0.5 * (low + e) * (at - i) * self._knot
        if self.kind == "bounded":
            u = u + e * (x - np.clip(x, -1.0, 1.0))
        return e, u


def moved(law: Law, servos: Servos, x: Array, v: Array, periods: int) -> Found:
    """Let servos move.

    Args:
        law: For each servo.
        servos: Servos and gains.
        x: Positions at the start, with no torque before.
        v: Velocities at the start.
        periods: How long.
    """
    delta, n = servos.damping, np.floor(servos.delay).astype(np.intp)
    part = servos.delay - n
    first, second = _steps(delta, part), _steps(delta, 1.0 - part)
    rows, size = np.arange(delta.size), int(n.max()) + 2
    ring = np.zeros((size, delta.size))
    before = x - v
    kinetic = np.zeros((QUARTERS, delta.size))
    energy = np.zeros((QUARTERS, delta.size))
    start = np.zeros(delta.size)
    for k in range(periods):
        speed = x - before
        before = x
        e, u = law.at(x, speed)
        torque = -servos.stiffness * e - servos.virtual_damping * speed
        if law.kind == "stops":
            torque = np.where(e * torque < 0.0, torque, 0.0)
        ring[k % size] = torque
        own = 0.5 * v * v
        whole = own + servos.stiffness * u
        if k == 0:
            start = whole
        quarter = QUARTERS * k // periods
        np.maximum(kinetic[quarter], own, out=kinetic[quarter])
        np.maximum(energy[quarter], whole, out=energy[quarter])
        for (decay, reach, push), age in ((first, n + 1), (second, n)):
            acting = ring[(k - age) % size, rows]
            x = x + reach * v + push * acting
            v = decay * v + reach * acting
    return Found(kinetic, energy, start)


def _steps(delta: Array, time: Array) -> tuple[Array, Array, Array]:
    """Return what a time does: decay of v, way by v and speed by torque, way by torque."""
    small = delta * time < 1e-4
    safe = np.where(small, 1.0, delta)
    decay = np.exp(-delta * time)
    reach = np.where(small, time - 0.5 * delta * time**2, (1.0 - decay) / safe)
    push = np.where(small, 0.5 * time**2 - delta * time**3 / 6.0, (time - reach) / safe)
    return decay, reach, push


def lasting(found: Found, floor: Array) -> Array:
    """Return how far a motion lasts: about 1 and more where it goes on, below where it decays.

    The lesser of the kinetic energy's and the whole energy's ratio from the second to the last
    quarter: a shaft that falls from a crest gains the one, a shaft that rests on a slope of no law
    keeps the other.

    Args:
        found: Of the motion.
        floor: Kinetic energy below which it is at rest.
    """
    kinetic = found.kinetic[-1] / np.maximum(found.kinetic[1], 1e-300)
    energy = found.energy[-1] / np.maximum(found.energy[1], 1e-300)
    return np.where(found.kinetic[-1] > floor, np.minimum(kinetic, energy), 0.0)
