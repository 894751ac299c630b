"""The sampled response of a device that a hand holds, and the poles of its loop with a wall.

The hand is a mass that moves with the device, and a damper and a spring to the ground. The plant is
then a damped oscillator.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.theory.checks import ComplexArray, FloatArray

_TERMS = 18  # of the exponential, to rounding below _SMALL
_SMALL = 0.5


@dataclass(frozen=True, slots=True)
class HeldHand:
    """The device with its hand over one period under a held torque: period 1, total mass 1."""

    step: FloatArray
    """Transition of (position, speed), less the identity; 2 × 2"""
    new: FloatArray
    """State change per unit of the torque of ``whole`` periods ago"""
    old: FloatArray
    """State change per unit of the torque before it, which acts during the fraction of the delay"""
    whole: int
    samples: int

    @classmethod
    def of(cls, delta: float, spring: float, delay: float, n_samples: int) -> HeldHand:
        """Return the response for dimensionless damping and spring, and a delay in periods."""
        whole = int(delay)
        full = _motion(delta, spring, 1.0)
        late = _motion(delta, spring, 1.0 - (delay - whole))
        return cls(full[:2, :2], late[:2, 2], full[:2, 2] - late[:2, 2], whole, n_samples)

    def inverse(self, w: FloatArray) -> ComplexArray:
        """Return F(w) = -1 / G_d(exp(j w)), G_d from the commanded torque to the position."""
        z_1 = 2j * np.sin(w / 2) * np.exp(0.5j * w)  # z - 1, without cancellation
        (e11, e12), (e21, e22) = self.step
        back = np.exp(-1j * w)
        torque = self.new[0] + self.old[0] * back, self.new[1] + self.old[1] * back
        moved = (z_1 - e22) * torque[0] + e12 * torque[1]
        late = np.exp(1j * w * self.whole)
        result: ComplexArray = -((z_1 - e11) * (z_1 - e22) - e12 * e21) / moved * late
        return result

    def difference(self, w: FloatArray) -> ComplexArray:
        """Return D(w) = (1 - exp(-j N w)) / N."""
        half = self.samples * w / 2
        result: ComplexArray = 2j * np.sin(half) * np.exp(-1j * half) / self.samples
        return result

    def poles(self, alpha: complex, beta: complex) -> ComplexArray:
        """Return the closed-loop poles: eigenvalues of plant, delay ring and past positions."""
        torques = self.whole + 1
        size = 2 + torques + self.samples
        command = np.zeros(size, dtype=np.complex128)
        command[0] = -alpha - beta / self.samples
        command[-1] = beta / self.samples
        a = np.zeros((size, size), dtype=np.complex128)
        a[:2, :2] = self.step + np.eye(2)
        a[:2, 1 + torques] += self.old
        if self.whole:
            a[:2, torques] += self.new
        else:
            a[:2] += np.outer(self.new, command)
        a[2] = command
        shifted = np.arange(3, 2 + torques)
        a[shifted, shifted - 1] = 1.0
        a[2 + torques, 0] = 1.0
        shifted = np.arange(3 + torques, size)
        a[shifted, shifted - 1] = 1.0
        real = not np.any(a.imag)
        return np.linalg.eigvals(a.real if real else a).astype(np.complex128)


def _motion(delta: float, spring: float, time: float) -> FloatArray:
    """Return exp of the motion matrix of (position, speed, held torque) over ``time``, less 1.

    It sums the series for a small part of the time and doubles the result up to the whole.
    """
    a = np.array([[0.0, 1.0, 0.0], [-spring, -delta, 1.0], [0.0, 0.0, 0.0]]) * time
    doublings = max(0, int(np.ceil(np.log2(max(np.max(np.abs(a).sum(axis=1)), 1e-9) / _SMALL))))
    a = a / 2.0**doublings
    result = a.copy()
    term = a
    for k in range(2, _TERMS):
        term = term @ a / k
        result = result + term
    for _ in range(doublings):
        result = 2 * result + result @ result
    return result
