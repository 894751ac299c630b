"""Simulates the errors of an encoder: eccentricity of its magnet, and noise."""

from __future__ import annotations

import math

from haptic_wall.hw.truth import TrueServo

NOISE_NS = 100_000
"""The noise has a new value this often [ns]. A value belongs to its time, not to a reading: further
readings do not change it."""
_MASK = (1 << 64) - 1
_UNIT = 2.0**-53


class EncoderErrors:
    """Computes the reading of an encoder from the true position.

    A magnet that is off the axis by d turns the field at a sensor of radius r by d / r times the
    sine of the shaft's angle: an error of one period a turn.
    """

    def __init__(self, true: TrueServo) -> None:
        self._amplitude, self._phase = true.encoder_eccentricity, true.encoder_phase
        self._noise, self._seed = true.encoder_noise, true.noise_seed

    def position(self, position: float) -> float:
        """Return the position that the encoder sees [rad], without noise."""
        if self._amplitude == 0.0:
            return position
        return position + self._amplitude * math.sin(position + self._phase)

    def noise(self, elapsed_ns: int) -> float:
        """Return the normally distributed noise at a time [counts]; it depends on time and seed."""
        if self._noise == 0.0:
            return 0.0
        index = elapsed_ns // NOISE_NS
        radius = math.sqrt(-2.0 * math.log(_uniform(self._seed, 2 * index)))
        return self._noise * radius * math.cos(math.tau * _uniform(self._seed, 2 * index + 1))


def _uniform(seed: int, index: int) -> float:
    """Return a pseudo-random number above 0 up to 1, a function of the two arguments.

    Source: SplitMix64, Steele et al., "Fast splittable pseudorandom number generators" (2014).
    """
    word = (seed * 0xD1342543DE82EF95 + (index + 1) * 0x9E3779B97F4A7C15) & _MASK
    word = ((word ^ word >> 30) * 0xBF58476D1CE4E5B9) & _MASK
    word = ((word ^ word >> 27) * 0x94D049BB133111EB) & _MASK
    return float(((word ^ word >> 31) >> 11) + 1) * _UNIT
