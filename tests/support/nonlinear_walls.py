"""Simulation in time of two-sided walls with one nonlinearity each, many at once.

Nothing here uses ``haptic_wall``: the predictions of ``haptic_wall.controller.theory.cycles`` are
held against it. A servo without friction moves exactly under each held torque. A turn of the motion
between two samples takes up the backlash too.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

PERIOD = 1e-3
"""[s]"""
Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Walls:
    """Walls and their servos; flat arrays of one length."""

    inertia: Array
    """m > 0 [kg·m²]"""
    damping: Array
    """b > 0 [N·m·s/rad]"""
    stiffness: Array
    """K [N·m/rad]"""
    virtual_damping: Array
    """B [N·m·s/rad]"""
    delay: Array
    """From the sample to its torque acting [s]"""
    limit: Array
    """Torque limit [N·m]; inf: none"""
    count: Array
    """One count of the encoder [rad]; 0: not quantised"""
    edge: Array
    """Where position 0 is within a count [counts]: 0 in the middle, 0.5 at an edge"""
    backlash: Array
    """Between body and encoder, full width [rad]; 0: none"""

    def take(self, index: Indices) -> Walls:
        """Those at ``index``."""
        return Walls(*(getattr(self, field.name)[index] for field in fields(self)))


class Motion:
    """Walls in motion, from a turning point on, after a past of steady sinusoidal oscillation."""

    def __init__(self, walls: Walls, amplitude: Array, frequency: Array) -> None:
        """Let go.

        Args:
            walls: Shape (n,).
            amplitude: Amplitude of the past oscillation of each [rad].
            frequency: Frequency of the same [Hz].
        """
        self._walls = walls
        late = walls.delay / PERIOD
        self._whole = np.floor(late + 1e-9).astype(np.int64)
        lag = np.maximum(late - self._whole, 0.0) * PERIOD
        self._parts = [
            (_response(walls, lag), self._whole + 1),
            (_response(walls, PERIOD - lag), self._whole),
        ]
        self._ring = np.zeros((int(self._whole.max()) + 2, amplitude.size))
        self._followed, self._before = np.zeros(amplitude.size), np.zeros(amplitude.size)
        self._k = 0
        w = 2.0 * np.pi * frequency * PERIOD
        turn = int(np.max(2.0 * np.pi / w)) + self._ring.shape[0]
        for i in range(-turn, 0):
            self._take(amplitude * np.cos(w * i), i)
        self.position, self.velocity = amplitude.copy(), np.zeros(amplitude.size)

    def run(self, periods: int) -> Array:
        """Positions at the next samples [rad], shape (periods, n)."""
        seen = np.empty((periods, self.position.size))
        rows = np.arange(self.position.size)
        half = 0.5 * self._walls.backlash
        for row in seen:
            row[:] = self.position
            self._take(self.position, self._k)
            for (moved, kept, shift, push, duration), back in self._parts:
                torque = self._ring[(self._k - back) % self._ring.shape[0], rows]
                v = self.velocity
                after = kept * v + push * torque
                turning = np.flatnonzero(v * after < 0.0)
                if turning.size:
                    share = v[turning] / (v[turning] - after[turning])
                    turned = self.position[turning] + 0.5 * v[turning] * share * duration[turning]
                    self._followed[turning] = np.clip(
                        self._followed[turning], turned - half[turning], turned + half[turning]
                    )
                self.position = self.position + moved * v + shift * torque
                self.velocity = after
            self._k += 1
        return seen

    def keep(self, index: Indices) -> None:
        """Go on with the walls at ``index`` only."""
        self._walls = self._walls.take(index)
        self._whole = self._whole[index]
        self._parts = [
            ((a[index], b[index], c[index], d[index], e[index]), back[index])
            for (a, b, c, d, e), back in self._parts
        ]
        self._ring = self._ring[:, index]
        self._followed, self._before = self._followed[index], self._before[index]
        self.position, self.velocity = self.position[index], self.velocity[index]

    def _take(self, position: Array, k: int) -> None:
        """Sample the position and compute the torque."""
        walls, half = self._walls, 0.5 * self._walls.backlash
        self._followed = np.clip(self._followed, position - half, position + half)
        counted = walls.count > 0.0
        count = np.where(counted, walls.count, 1.0)
        rounded = count * (np.rint(self._followed / count + walls.edge) - walls.edge)
        measured = np.where(counted, rounded, self._followed)
        speed = (measured - self._before) / PERIOD
        torque = -walls.stiffness * measured - walls.virtual_damping * speed
        self._ring[k % self._ring.shape[0]] = np.clip(torque, -walls.limit, walls.limit)
        self._before = measured


def _response(walls: Walls, time: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Over ``time`` [s]: position and velocity from velocity, then from torque; and ``time``."""
    rate = walls.damping / walls.inertia
    moved = -np.expm1(-rate * time) / rate
    shift = (time - moved) / walls.damping
    return moved, np.exp(-rate * time), shift, moved / walls.inertia, time
