"""Coulomb friction: the passive stiffness with an encoder, and the kick above which motion grows.

To a sinusoidal motion of amplitude A and angular frequency w, Coulomb friction c acts as a viscous
damping ``b_x = 4 c / (pi A w)``: large at small amplitudes, small at large ones. Above the critical
stiffness there is therefore an *unstable* limit cycle: smaller motion decays, larger motion grows
(until the torque saturates). Its amplitude is the largest kick that such a wall survives.
"""

from __future__ import annotations

from typing import NamedTuple

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
from haptic_wall.controller.theory.exact import critical_point, critical_stiffness

_DOUBLINGS = 200
_STEPS = 60  # false position takes about ten


class Onset(NamedTuple):
    """The unstable limit cycle of a wall above its critical stiffness, on a body with friction."""

    amplitude: FloatArray
    """Position amplitude [rad]: smaller motion decays, larger motion grows"""
    frequency: FloatArray
    """Frequency of the oscillation there [Hz]"""


def friction_limit(
    damping: ArrayLike, coulomb: ArrayLike, encoder_step: ArrayLike, period: ArrayLike
) -> FloatArray:
    """Return the stiffness up to which a pure spring on a quantised position is passive.

    It holds for a wall without virtual damping and without delay.

    Args:
        damping: Viscous damping b >= 0 [N·m·s/rad].
        coulomb: Coulomb friction c >= 0 [N·m].
        encoder_step: One count q >= 0 [rad]; 0: no quantisation.
        period: T > 0 [s].

    Returns:
        min(2 b / T, 2 c / q) [N·m/rad] in the broadcast shape.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: Abbott and Okamura, IEEE T-RO 21(5), 2005, the condition for passivity of the wall.
    """
    b, c, q, t = broadcast(
        damping=not_negative("damping", damping),
        coulomb=not_negative("coulomb", coulomb),
        encoder_step=not_negative("encoder_step", encoder_step),
        period=positive("period", period),
    )
    by_friction = np.where(q > 0, 2 * c / np.where(q > 0, q, 1.0), np.inf)
    result: FloatArray = np.minimum(2 * b / t, by_friction)[()]
    return result


def onset_amplitude(
    inertia: ArrayLike,
    damping: ArrayLike,
    coulomb: ArrayLike,
    stiffness: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike = 1,
) -> Onset:
    """Return the amplitude above which motion grows in a wall above its critical stiffness.

    It solves for the extra damping ``b_x`` that puts the two-sided wall on its exact boundary; the
    amplitude is ``4 c / (pi b_x w)``. Extra damping raises the ceiling of the virtual damping too,
    so a virtual damping above the ceiling (or below -b) has an onset too.

    A first-harmonic result, within 5 % of exact simulation for small servos at 1 kHz with onsets
    from 20 counts of 4096 to 1 rad. Where the needed friction is not small beside the inertia
    (``b_x`` near ``m w``: far above the limit, with onsets of a count) the true onset is larger, up
    to 1.5 times. It assumes a motion that has oscillated before: a body released from rest with no
    delayed torques has another onset.

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous damping b >= 0 [N·m·s/rad].
        coulomb: Coulomb friction c >= 0 [N·m].
        stiffness: K > 0 [N·m/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        velocity_samples: N of the velocity difference, >= 1.

    Returns:
        Amplitude and frequency in the broadcast shape. The amplitude is inf where the wall is
        stable without friction (at or below the limit: nothing grows, the frequency is the one at
        the limit), and 0 where it is unstable and there is no friction: all motion grows.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.

    Source: describing function of Coulomb friction (Gelb and Vander Velde, Multiple-Input
    Describing Functions, 1968) in Gil et al., ICRA 2007, eq. (11).
    """
    arrays = broadcast(
        inertia=positive("inertia", inertia),
        damping=not_negative("damping", damping),
        coulomb=not_negative("coulomb", coulomb),
        stiffness=positive("stiffness", stiffness),
        virtual_damping=number("virtual_damping", virtual_damping),
        period=positive("period", period),
        delay=not_negative("delay", delay),
        velocity_samples=samples("velocity_samples", velocity_samples),
    )
    m, b, c, k, big_b, t, t_d, n = (np.ravel(array) for array in arrays)
    shape = arrays[0].shape
    amplitude = np.full(m.size, np.inf)
    extra = np.zeros(m.size)
    above = np.flatnonzero(k > critical_stiffness(m, b, big_b, t, t_d, n))
    if above.size:
        rows = (a[above] for a in (m, b, k, big_b, t, t_d, n))
        extra[above] = _extra_damping(*rows)
    frequency = critical_point(m, b + extra, big_b, t, t_d, n).frequency
    w = 2 * np.pi * frequency[above]
    amplitude[above] = np.where(
        c[above] > 0, 4 * c[above] / (np.pi * np.maximum(extra[above] * w, 1e-300)), 0.0
    )
    return Onset(amplitude.reshape(shape)[()], frequency.reshape(shape)[()])


def _extra_damping(
    m: FloatArray,
    b: FloatArray,
    k: FloatArray,
    big_b: FloatArray,
    t: FloatArray,
    t_d: FloatArray,
    n: FloatArray,
) -> FloatArray:
    """Solve K_crit(b + b_x, B) = K for ``b_x > 0``: K_crit rises with the damping, without bound.

    False position (Illinois form) on (K_crit - K) / (K_crit + K), which is finite everywhere.
    """

    def short(extra: FloatArray) -> FloatArray:
        limit = critical_stiffness(m, b + extra, big_b, t, t_d, n)
        result: FloatArray = (limit - k) / (limit + k)
        return result

    low = np.zeros_like(m)
    at_low = short(low)
    high = np.maximum(k * (t / 2 + t_d) - b - big_b, 1e-3 * (b + k * t))
    for _ in range(_DOUBLINGS):
        at_high = short(high)
        if np.all(at_high >= 0):
            break
        low = np.where(at_high < 0, high, low)
        at_low = np.where(at_high < 0, at_high, at_low)
        high = np.where(at_high < 0, 2 * high, high)
    last = np.zeros_like(m)
    guess = high
    for _ in range(_STEPS):
        slope = at_high - at_low
        guess = low - at_low * (high - low) / np.where(slope > 0, slope, 1.0)
        value = short(guess)
        up = value >= 0
        again = np.where(up, 1.0, -1.0) == last
        at_low = np.where(up, np.where(again, 0.5 * at_low, at_low), value)
        at_high = np.where(up, value, np.where(again, 0.5 * at_high, at_high))
        low, high = np.where(up, low, guess), np.where(up, guess, high)
        last = np.where(up, 1.0, -1.0)
        if np.all((np.abs(value) < 1e-13) | (high - low < 1e-13 * high)):
            break
    return guess
