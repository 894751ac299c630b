"""Returns the loop as transfer functions and state matrices, for python-control, scipy or Matlab.

Plain numpy arrays in SI units, polynomials with the highest power of z first, sampling period T.
Any delay: a fraction of a period splits the hold, which adds a zero and a delayed torque. For
example ``scipy.signal.dlti(*pulse_transfer(...), dt=T)`` or ``control.ss(*closed_loop(...), T)``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from haptic_wall.controller.theory.checks import (
    FloatArray,
    not_negative,
    number,
    positive,
    samples,
    scalar,
)
from haptic_wall.controller.theory.response import held_response


class TransferFunction(NamedTuple):
    """num(z) / den(z); coefficients of falling powers."""

    num: FloatArray
    den: FloatArray


class StateSpace(NamedTuple):
    """x[k+1] = a x[k] + b u[k], y[k] = c x[k] + d u[k]; two-dimensional arrays."""

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray


class _Hold(NamedTuple):
    """Response over one period to position, speed and the two torques that act in it."""

    whole: int
    """The torque of this many periods ago acts until the end of the period"""
    split: bool
    """The torque before it acts at the period's start"""
    phi: float
    """Position per speed at the start [s]"""
    kept: float
    """Speed per speed at the start"""
    new: tuple[float, float]
    """Position [rad] and speed [rad/s] per unit of the later torque"""
    old: tuple[float, float]
    """Position and speed per unit of the earlier torque"""


def pulse_transfer(inertia: float, damping: float, period: float, delay: float) -> TransferFunction:
    """Return the transfer from commanded torque to sampled position, the delay included.

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous damping b >= 0 [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].

    Returns:
        Gain in rad per N·m; order 2 + d, and one more where d is not whole.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, G(z) of eq. (11); fractions by the modified z-transform.
    """
    hold = _hold(inertia, damping, period, delay)
    speed_pole = np.array([1.0, -hold.kept])
    latest = hold.new[0] * speed_pole + np.array([0.0, hold.phi * hold.new[1]])
    before = hold.old[0] * speed_pole + np.array([0.0, hold.phi * hold.old[1]])
    num = np.append(latest, 0.0) + np.append(0.0, before) if hold.split else latest
    delays = np.zeros(hold.whole + int(hold.split))
    return TransferFunction(num, np.append(np.convolve([1.0, -1.0], speed_pole), delays))


def wall_transfer(
    stiffness: float, virtual_damping: float, period: float, velocity_samples: int = 1
) -> TransferFunction:
    """Return the wall's transfer from position to subtracted torque: K + B (1 - z^-N) / (N T).

    Args:
        stiffness: K [N·m/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        velocity_samples: N of the velocity difference, >= 1.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, eq. (11), the bracket.
    """
    n = int(scalar(samples, "velocity_samples", velocity_samples))
    per_sample = scalar(number, "virtual_damping", virtual_damping) / (
        n * scalar(positive, "period", period)
    )
    num, den = np.zeros(n + 1), np.zeros(n + 1)
    num[0], den[0] = scalar(number, "stiffness", stiffness) + per_sample, 1.0
    num[n] -= per_sample
    return TransferFunction(num, den)


def plant(inertia: float, damping: float, period: float, delay: float) -> StateSpace:
    """Return the device with a held, delayed torque; input commanded torque, output position.

    States: position [rad], speed [rad/s], then the commanded torques that still have to act [N·m],
    the latest first.

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous damping b >= 0 [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0 [s].

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    hold = _hold(inertia, damping, period, delay)
    torques = hold.whole + int(hold.split)
    # column i of ``commanded`` is the torque of i periods ago: 0 the input, then the states
    commanded = np.zeros((2, torques + 1))
    commanded[:, hold.whole] += hold.new
    if hold.split:
        commanded[:, hold.whole + 1] += hold.old
    a, b = np.zeros((2 + torques, 2 + torques)), np.zeros((2 + torques, 1))
    a[:2, :2] = [[1.0, hold.phi], [0.0, hold.kept]]
    a[:2, 2:], b[:2] = commanded[:, 1:], commanded[:, :1]
    if torques:
        b[2] = 1.0
        a[3:, 2:-1] = np.eye(torques - 1)
    c = np.zeros((1, 2 + torques))
    c[0, 0] = 1.0
    return StateSpace(a, b, c, np.zeros((1, 1)))


def closed_loop(
    inertia: float,
    damping: float,
    stiffness: float,
    virtual_damping: float,
    period: float,
    delay: float,
    velocity_samples: int = 1,
) -> StateSpace:
    """Return device and two-sided wall at position 0; the poles are the eigenvalues of ``a``.

    States: those of ``plant``, then the last N sampled positions, the latest first. Input: a torque
    added to the command [N·m]; output: position [rad].

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous damping b >= 0 [N·m·s/rad].
        stiffness: K [N·m/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0 [s].
        velocity_samples: N of the velocity difference, >= 1.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gil et al., ICRA 2007, eq. (11), in state space.
    """
    device = plant(inertia, damping, period, delay)
    wall = wall_transfer(stiffness, virtual_damping, period, velocity_samples)
    size, n = len(device.a), len(wall.num) - 1
    a, b = np.zeros((size + n, size + n)), np.zeros((size + n, 1))
    a[:size, :size], b[:size] = device.a, device.b
    a[size, 0] = 1.0
    a[size + 1 :, size:-1] = np.eye(n - 1)
    torque = np.zeros((1, size + n))
    torque[0, 0] = -wall.num[0]
    torque[0, -n:] -= wall.num[1:]
    c = np.zeros((1, size + n))
    c[0, 0] = 1.0
    return StateSpace(a + b @ torque, b, c, np.zeros((1, 1)))


def _hold(inertia: float, damping: float, period: float, delay: float) -> _Hold:
    m, t = scalar(positive, "inertia", inertia), scalar(positive, "period", period)
    delta = np.array(scalar(not_negative, "damping", damping) * t / m)
    late = scalar(not_negative, "delay", delay) / t
    whole = int(np.floor(late))
    full, rest = held_response(delta, 1.0), held_response(delta, 1.0 - (late - whole))
    # from unit period and inertia to seconds and kg·m²
    position, speed = t * t / m, t / m
    new = (
        float(rest.position_per_torque) * position,
        float(rest.position_per_speed) * speed,
    )
    return _Hold(
        whole=whole,
        split=late > whole,
        phi=float(full.position_per_speed) * t,
        kept=float(full.speed_per_speed),
        new=new,
        old=(
            float(full.position_per_torque) * position - new[0],
            float(full.position_per_speed) * speed - new[1],
        ),
    )
