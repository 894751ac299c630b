"""Simulates errors of many encoders at once; the array form of ``haptic_wall.hw.plant.encoder``."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from haptic_wall.hw.plant.encoder import NOISE_NS

Floats = NDArray[np.float64]
Words = NDArray[np.uint64]


@dataclass(frozen=True, slots=True)
class ManyEncoderErrors:
    """Errors of many encoders, arrays of one length."""

    eccentricity: Floats
    """Amplitude of the error once a turn [rad]"""
    phase: Floats
    """Phase of that error at position 0 [rad]"""
    noise: Floats
    """Standard deviation [counts]"""
    seed: Words
    """Decides what the noise is"""
    offset: Floats
    """Added to every reading [rad]: where the encoder's zero is"""

    def take(self, index: NDArray[np.intp] | slice) -> ManyEncoderErrors:
        """Return the errors of the encoders at ``index``."""
        return ManyEncoderErrors(*(getattr(self, field.name)[index] for field in fields(self)))

    def position(self, position: Floats) -> Floats:
        """Return the positions that the encoders see [rad], without noise."""
        error: Floats = self.eccentricity * np.sin(position + self.phase) + self.offset
        return position + error

    def noise_at(self, elapsed_ns: NDArray[np.int64]) -> Floats:
        """Return the noise at these times since the start [counts]."""
        index = (elapsed_ns // NOISE_NS).astype(np.uint64) * np.uint64(2)
        radius = np.sqrt(-2.0 * np.log(_uniform(self.seed, index)))
        turned = np.cos(math.tau * _uniform(self.seed, index + np.uint64(1)))
        result: Floats = self.noise * radius * turned
        return result


def _uniform(seed: Words, index: Words) -> Floats:
    """Return numbers above 0 up to 1, as ``haptic_wall.hw.plant.encoder`` does."""
    word = seed * np.uint64(0xD1342543DE82EF95)
    word += (index + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    word = (word ^ word >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ word >> np.uint64(27)) * np.uint64(0x94D049BB133111EB)
    word ^= word >> np.uint64(31)
    return ((word >> np.uint64(11)) + np.uint64(1)).astype(np.float64) * 2.0**-53
