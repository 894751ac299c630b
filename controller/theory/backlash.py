"""Computes the stiffness below which backlash before the encoder sustains no large oscillation.

Backlash lags, and so feeds an oscillation; Coulomb friction takes from it. To a sinusoid of
amplitude A both are gains (``describing``): N(A) multiplies the wall's whole torque, 4 c/(pi A w)
adds to the damping of the servo. A cycle of that amplitude and frequency w sustains itself where::

    K + B D(w) = F(w, A) / N(A)

The limit is the least K > 0 of all cycles of at least a given amplitude. Without friction there are
cycles at nearly any stiffness; with it, small backlash needs a stiff wall.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from haptic_wall.controller.theory.checks import (
    FloatArray,
    broadcast,
    not_negative,
    number,
    positive,
    samples,
)
from haptic_wall.controller.theory.describing import backlash_gain
from haptic_wall.controller.theory.loop import HeldLoop

_AMPLITUDES, _LARGEST = 24, 1.0
"""Amplitudes that are looked at, up to this one [rad]"""
_FREQUENCIES = 80
_NEAR = np.linspace(-1.0, 2.0, 10)
"""Then frequencies about the least of each amplitude, in steps between these"""
_SLOWEST, _FASTEST = 1e-3, 2.5
"""Frequencies that are looked at [rad/sample], in periods of one delay and one sample"""
_CHUNK = 64


def backlash_limit(
    inertia: ArrayLike,
    damping: ArrayLike,
    coulomb: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    width: ArrayLike,
    amplitude: ArrayLike,
    velocity_samples: ArrayLike = 1,
) -> FloatArray:
    """Return the stiffness up to which no oscillation of an amplitude or more sustains itself.

    By harmonic balance, for a two-sided wall; no more than a grid of frequencies and amplitudes
    finds.

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous damping b >= 0 [N·m·s/rad].
        coulomb: Coulomb friction c >= 0 [N·m].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        width: Full width of the backlash between shaft and encoder, > 0 [rad].
        amplitude: Least amplitude of the shaft that counts, > 0 [rad]; more than half the width is
            looked at in any case.
        velocity_samples: N of the velocity difference, >= 1.

    Returns:
        Stiffness [N·m/rad] in the broadcast shape; infinite where nothing is found.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Gelb and Vander Velde, Multiple-Input Describing Functions, 1968, sec. 2.3.
    """
    arrays = broadcast(
        inertia=positive("inertia", inertia),
        damping=not_negative("damping", damping),
        coulomb=not_negative("coulomb", coulomb),
        virtual_damping=number("virtual_damping", virtual_damping),
        period=positive("period", period),
        delay=not_negative("delay", delay),
        width=positive("width", width),
        amplitude=positive("amplitude", amplitude),
        velocity_samples=samples("velocity_samples", velocity_samples),
    )
    flat = [np.ravel(array) for array in arrays]
    found = [
        _least(*(each[start : start + _CHUNK, None, None] for each in flat))
        for start in range(0, flat[0].size, _CHUNK)
    ]
    result: FloatArray = np.concatenate(found).reshape(arrays[0].shape)[()]
    return result


def _least(
    inertia: FloatArray,
    damping: FloatArray,
    coulomb: FloatArray,
    virtual_damping: FloatArray,
    period: FloatArray,
    delay: FloatArray,
    width: FloatArray,
    amplitude: FloatArray,
    velocity_samples: FloatArray,
) -> FloatArray:
    """Return the limits of settings along the first of three axes: settings, amplitudes, w."""
    begin = np.maximum(amplitude, 0.501 * width)
    ratio = np.maximum(_LARGEST, 2.0 * begin) / begin
    late = 1.0 + delay / period
    every_a, every_w = (np.linspace(0.0, 1.0, n) for n in (_AMPLITUDES, _FREQUENCIES))

    def crossings(part_a: FloatArray, part_w: FloatArray) -> FloatArray:
        """Return the stiffness of cycles between neighbouring frequencies; infinite if none."""
        a = begin * ratio**part_a
        w = _SLOWEST * (_FASTEST / _SLOWEST) ** part_w / late
        b = damping + 4.0 * coulomb / (np.pi * a * w / period)
        delta = b * period / inertia
        loop = HeldLoop.of(delta, np.broadcast_to(delay / period, delta.shape), velocity_samples)
        balance = loop.inverse_plant(w) * (inertia / period**2) / backlash_gain(a, width)
        balance = balance - virtual_damping / period * loop.difference(w)
        imaginary, stiffness = balance.imag, balance.real
        before, after = imaginary[..., :-1], imaginary[..., 1:]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = before / (before - after)
            at = stiffness[..., :-1] + share * (stiffness[..., 1:] - stiffness[..., :-1])
        found: FloatArray = np.where((np.sign(before) != np.sign(after)) & (at > 0), at, np.inf)
        return found

    coarse = crossings(every_a[:, None], every_w)
    cell = coarse.argmin(axis=2)[..., None] + _NEAR
    fine = crossings(every_a[:, None], np.clip(cell / (_FREQUENCIES - 1), 0.0, 1.0))
    least: FloatArray = np.minimum(coarse.min(axis=(1, 2)), fine.min(axis=(1, 2)))
    return least
