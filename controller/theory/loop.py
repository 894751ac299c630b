"""Computes the sampled loop's frequency response, ``z = exp(j w)``, without cancellation.

Dimensionless (period 1, inertia 1). The plant with a held torque that acts ``d = n + f`` periods
late has the pulse transfer ``G_d = z^-(n+1) (b2 z² + b1 z + b0) / ((z - 1) (z - eps))``; a fraction
of a period splits the hold (modified z-transform). With ``s = 2 sin(w/2)``, ``c = cos(w/2)``,
``M = |b2 z + b1 + b0/z|²`` and ``X + j Y = exp(j (n+1) w) conj(b2 z + b1 + b0/z)``::

    F = -1/G_d = s (P + j Q) / M,    P = q X + r Y,  Q = q Y - r X
    q = (1 + eps) s / 2,             r = (1 - eps) c

For any damping, no term of F is a small difference of large numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.theory.checks import ComplexArray, FloatArray
from haptic_wall.controller.theory.response import held_response


@dataclass(frozen=True, slots=True)
class HeldLoop:
    """The loop without its wall: plant, hold, delay and velocity difference.

    The fields are arrays of shapes that broadcast with the frequencies.
    """

    delta: FloatArray
    delay: FloatArray
    samples: FloatArray
    lead: FloatArray
    """n + 1: the whole periods of the delay, and one period of the hold"""
    decay: FloatArray
    """1 - eps: fraction of its speed that the free device loses in a period"""
    b_sum: FloatArray
    """b2 + b1 + b0"""
    b_even: FloatArray
    """b2 + b0"""
    b_odd: FloatArray
    """b2 - b0"""

    @classmethod
    def of(cls, delta: FloatArray, delay: FloatArray, samples: FloatArray) -> HeldLoop:
        """Return the loop for arrays of delta, d and N."""
        whole = np.floor(delay)
        full = held_response(delta, 1.0)
        late = held_response(delta, 1.0 - (delay - whole))
        phi = full.position_per_speed
        eps = full.speed_per_speed
        # the period starts with the torque of n + 1 periods ago and ends with that of n periods ago
        b2 = late.position_per_torque
        old_position = full.position_per_torque - b2
        old_speed = phi - late.position_per_speed
        b0 = phi * old_speed - eps * old_position
        return cls(
            delta=delta,
            delay=delay,
            samples=samples,
            lead=whole + 1.0,
            decay=delta * phi,
            b_sum=phi,
            b_even=b2 + b0,
            b_odd=b2 - b0,
        )

    def inverse_plant(self, w: FloatArray) -> ComplexArray:
        """Return F(w) = -1 / G_d(exp(j w)), G_d from the commanded torque to the position."""
        half = 0.5 * w
        s, c = 2.0 * np.sin(half), np.cos(half)
        real, imag = self.b_sum - 0.5 * self.b_even * s * s, self.b_odd * s * c
        turned = np.exp(1j * self.lead * w) * (real - 1j * imag)
        numerator = s * ((1.0 - 0.5 * self.decay) * s - 1j * self.decay * c)
        result: ComplexArray = numerator * turned / (real * real + imag * imag)
        return result

    def difference(self, w: FloatArray) -> ComplexArray:
        """Return D(w) = (1 - exp(-j N w)) / N."""
        half = self.samples * w / 2
        result: ComplexArray = 2j * np.sin(half) * np.exp(-1j * half) / self.samples
        return result
