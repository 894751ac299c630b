"""Coupled stability: the critical stiffness of a wall while a given hand holds the device.

The hand is a mass that moves with the device, and a damper and a spring to the ground. The plant is
then a damped oscillator. On the unit circle the loop is still linear in the wall's stiffness, so
each crossing of the circle is the zero of one real function of the frequency (see ``boundary``).
Unlike on a free device, more stiffness can make an unstable loop stable. The limit is therefore the
end of the stable interval that begins at zero stiffness; 0 where the damper alone is unstable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from haptic_wall.controller.theory.checks import (
    ComplexArray,
    FloatArray,
    broadcast,
    not_negative,
    number,
    positive,
    samples,
    scalar,
)
from haptic_wall.controller.theory.roots import dips, zeros

_TERMS = 18  # of the exponential, to rounding below _SMALL
_SMALL = 0.5


@dataclass(frozen=True, slots=True)
class Hand:
    """Mass, damper and spring of a hand that holds the device; every number may be an array."""

    mass: ArrayLike = 0.0
    """Moves with the device, >= 0 [kg·m²]"""
    damping: ArrayLike = 0.0
    """To the ground, >= 0 [N·m·s/rad]"""
    stiffness: ArrayLike = 0.0
    """To the ground, >= 0 [N·m/rad]"""


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


def coupled_limit(
    inertia: ArrayLike,
    damping: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    hand: Hand,
    velocity_samples: ArrayLike = 1,
) -> FloatArray:
    """Return the stiffness below which a two-sided wall is stable with this hand on the device.

    Exact for a linear hand, a held torque and any delay. With no hand it is ``critical_stiffness``;
    a hand of only mass or damping adds to the device's own.

    Args:
        inertia: m > 0 of the device [kg·m²].
        damping: Viscous damping b >= 0 of the device [N·m·s/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        hand: The hand that holds the device.
        velocity_samples: N of the velocity difference, >= 1.

    Returns:
        Stiffness [N·m/rad] in the broadcast shape; 0 where the loop is unstable (or undamped) with
        the least stiffness.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, eq. (11), with the plant of device and hand; solved on the unit
    circle.
    """
    m, b, big_b, t, t_d, n, m_h, b_h, k_h = broadcast(
        inertia=positive("inertia", inertia),
        damping=not_negative("damping", damping),
        virtual_damping=number("virtual_damping", virtual_damping),
        period=positive("period", period),
        delay=not_negative("delay", delay),
        velocity_samples=samples("velocity_samples", velocity_samples),
        hand_mass=not_negative("hand.mass", hand.mass),
        hand_damping=not_negative("hand.damping", hand.damping),
        hand_stiffness=not_negative("hand.stiffness", hand.stiffness),
    )
    total = m + m_h
    rows = ((b + b_h) * t / total, k_h * t**2 / total, t_d / t, n, big_b * t / total)
    alpha = np.array(
        [
            _critical(HeldHand.of(delta, spring, late, int(n_samples)), beta)
            for delta, spring, late, n_samples, beta in zip(
                *(row.ravel().tolist() for row in rows), strict=True
            )
        ]
    )
    result: FloatArray = (alpha.reshape(total.shape) * total / t**2)[()]
    return result


def is_stable(
    inertia: float,
    damping: float,
    stiffness: float,
    virtual_damping: float,
    period: float,
    delay: float,
    hand: Hand,
    velocity_samples: int = 1,
) -> bool:
    """Whether every closed-loop pole of one wall with one hand is inside the unit circle.

    Args:
        inertia: m > 0 of the device [kg·m²].
        damping: Viscous damping b >= 0 of the device [N·m·s/rad].
        stiffness: K [N·m/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        hand: The hand that holds the device; its values are single numbers.
        velocity_samples: N of the velocity difference, >= 1.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    total = scalar(positive, "inertia", inertia) + scalar(not_negative, "hand.mass", hand.mass)
    t = scalar(positive, "period", period)
    unit = t / total
    viscous = scalar(not_negative, "damping", damping)
    viscous += scalar(not_negative, "hand.damping", hand.damping)
    spring = scalar(not_negative, "hand.stiffness", hand.stiffness)
    plant = HeldHand.of(
        viscous * unit,
        spring * t * unit,
        scalar(not_negative, "delay", delay) / t,
        int(scalar(samples, "velocity_samples", velocity_samples)),
    )
    poles = plant.poles(
        scalar(number, "stiffness", stiffness) * t * unit,
        scalar(number, "virtual_damping", virtual_damping) * unit,
    )
    return bool(np.max(np.abs(poles)) < 1)


def _critical(plant: HeldHand, beta: float) -> float:
    """Return the lowest crossing of the circle over alpha > 0, where the loop is stable below."""
    w = _zeros(plant, beta)
    alpha = (plant.inverse(w) - beta * plant.difference(w)).real
    alpha = np.sort(alpha[alpha > 0])
    if not alpha.size or np.max(np.abs(plant.poles(alpha[0] / 2, beta))) >= 1:
        return 0.0
    return float(alpha[0])


def _zeros(plant: HeldHand, beta: float) -> FloatArray:
    """Return the frequencies on 0 < w <= pi at which some alpha, of any sign, has a pole there."""

    def imaginary(w: FloatArray) -> FloatArray:
        result: FloatArray = (plant.inverse(w) - beta * plant.difference(w)).imag
        return result

    count = 256 + 32 * (plant.whole + plant.samples)
    grid = np.concatenate(
        [np.geomspace(1e-6, 1e-2, 64, endpoint=False), np.linspace(1e-2, np.pi, count)[:-1]]
    )
    grid = np.append(grid, np.nextafter(np.pi, 0))
    grid = np.sort(np.append(grid, dips(imaginary, grid[None])))
    return np.append(zeros(imaginary, grid), np.pi)


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
