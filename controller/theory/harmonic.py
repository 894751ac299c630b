"""Harmonic balance: which oscillations friction and backlash end or sustain.

To a sinusoid of amplitude A and frequency w a nonlinearity is a gain N(A), complex where it lags,
or a damping. Backlash before the encoder multiplies the whole wall; Coulomb friction c adds
``4 c/(pi A w)`` to the damping of the servo. A cycle sustains itself where::

    N(A) (K + B D(w)) = F(w, A)

Friction, a dead band and drag take from an oscillation, backlash feeds it. Larger motion may grow
at less stiffness (friction), or at more (backlash): the limit is a property of the amplitude. Only
the harmonics of the oscillation are neglected, which the inertia filters.

Source: Gelb and Vander Velde, Multiple-Input Describing Functions, 1968, sec. 2.3.
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
from haptic_wall.controller.theory.response import difference, inverse_plant

_AMPLITUDES, _WIDTHS = 12, 10.0
"""Amplitudes of backlash that are looked at, up to so many widths: dense near the least, where the
limit is lowest. In 300 random settings the limit is up to 1.15 times that of a grid of 300"""
_FREQUENCIES = 56
_NEAR = np.linspace(-1.0, 2.0, 10)
"""Then frequencies about the least of each amplitude, in steps between these"""
_SLOWEST, _FASTEST = 1e-3, 2.5
"""Frequencies that are looked at [rad/sample], in periods of one delay and one sample"""
_CHUNK = 64
_COARSE, _FINE = 240, 40
_TURN = np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
_ROUNDS = 20
_LEAST = 0.05
"""Least gain of a dead band"""


def backlash_gain(amplitude: ArrayLike, width: ArrayLike) -> ComplexArray:
    """Return the complex gain of a backlash of full width ``width``; 0 for motion within it.

    Raises:
        ValueError: An argument is not > 0; the message names it.
    """
    a, w = broadcast(amplitude=positive("amplitude", amplitude), width=positive("width", width))
    share = np.minimum(w / (2 * a), 1.0)
    x = 1 - 2 * share
    real = 0.5 + (np.arcsin(x) + x * np.sqrt(1 - x**2)) / np.pi
    result: ComplexArray = real - 4j / np.pi * share * (1 - share)
    return result


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
    ratio = np.maximum(_WIDTHS * width, 2.0 * begin) / begin
    late = 1.0 + delay / period
    every_a, every_w = (np.linspace(0.0, 1.0, n) for n in (_AMPLITUDES, _FREQUENCIES))

    def crossings(part_a: FloatArray, part_w: FloatArray) -> FloatArray:
        a = begin * ratio**part_a**3
        w = _SLOWEST * (_FASTEST / _SLOWEST) ** part_w / late
        b = damping + 4.0 * coulomb / (np.pi * a * w / period)
        delta = b * period / inertia
        balance = inverse_plant(delta, delay / period, w) * (inertia / period**2)
        balance = balance / backlash_gain(a, width)
        balance = balance - virtual_damping / period * difference(velocity_samples, w)
        return _cycles(balance)

    coarse = crossings(every_a[:, None], every_w)
    cell = coarse.argmin(axis=2)[..., None] + _NEAR
    fine = crossings(every_a[:, None], np.clip(cell / (_FREQUENCIES - 1), 0.0, 1.0))
    least: FloatArray = np.minimum(coarse.min(axis=(1, 2)), fine.min(axis=(1, 2)))
    return least


def _cycles(balance: ComplexArray) -> FloatArray:
    """Return the stiffness of cycles between neighbouring frequencies; infinite if none.

    Args:
        balance: What the stiffness must be, along the last axis; its imaginary part is to be 0.
    """
    stiffness, before, after = balance.real, balance.imag[..., :-1], balance.imag[..., 1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = before / (before - after)
        at = stiffness[..., :-1] + share * (stiffness[..., 1:] - stiffness[..., :-1])
    found: FloatArray = np.where((np.sign(before) != np.sign(after)) & (at > 0), at, np.inf)
    return found


@dataclass(frozen=True, slots=True)
class Lossy:
    """A servo with what it does to an oscillation; torques in commanded units."""

    inertia: float
    """m > 0 [kg·m²]"""
    damping: float
    """b >= 0 [N·m·s/rad]"""
    coulomb: float = 0.0
    """c >= 0 [N·m]"""
    backlash: float = 0.0
    """Between shaft and encoder, full width [rad]"""
    gear: float = 0.0
    """Fraction of the torque that adds to the friction"""
    drag: float = 0.0
    """Friction with the square of the speed [N·m·s²/rad²]"""
    dead_band: float = 0.0
    """Torque that is missing of what is commanded [N·m]"""


def kick_limit(
    servo: Lossy,
    virtual_damping: float,
    period: float,
    delay: float,
    amplitude: float,
    velocity_samples: int = 1,
) -> float:
    """Return the least stiffness that sustains an oscillation of an amplitude, two-sided wall.

    Args:
        servo: The servo.
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        amplitude: As the encoder shows it, > 0 [rad].
        velocity_samples: N of the velocity difference, >= 1.

    Returns:
        [N·m/rad]; infinite where there is none.

    Raises:
        ValueError: Amplitude, period or inertia is not > 0.

    `haptic-wall sweep` measures within 5 % of it on the servos of its tests.
    """
    for name, value in (("amplitude", amplitude), ("period", period), ("inertia", servo.inertia)):
        scalar(positive, name, value)
    late = 1.0 + delay / period
    rates = np.geomspace(_SLOWEST / late, _FASTEST / late, _COARSE)
    loop = virtual_damping, period, delay, amplitude, velocity_samples
    rough = _cycles(_balance(servo, rates, *loop))
    at = int(np.argmin(rough))
    if np.isinf(rough[at]):
        return float("inf")
    near = np.linspace(rates[max(at - 1, 0)], rates[min(at + 2, _COARSE - 1)], _FINE)
    fine = float(_cycles(_balance(servo, near, *loop)).min())
    return float(rough[at]) if np.isinf(fine) else fine


def _balance(
    servo: Lossy,
    rates: FloatArray,
    virtual_damping: float,
    period: float,
    delay: float,
    amplitude: float,
    velocity_samples: int,
) -> ComplexArray:
    """Return what the stiffness must be at each frequency [N·m/rad]."""
    shaft = amplitude + 0.5 * servo.backlash
    w = rates / period
    ones = np.ones(rates.shape)
    gain: ComplexArray = ones.astype(np.complex128)
    if servo.backlash > 0.0:
        gain = backlash_gain(shaft * ones, servo.backlash * ones)
    spring_of_damper = virtual_damping / period * difference(velocity_samples, rates)
    sine, cosine = np.sin(_TURN), np.cos(_TURN)
    speed = shaft * w[:, None] * cosine
    coupled = servo.gear > 0.0 or servo.dead_band > 0.0
    turned = gain * shaft * np.exp(-1j * rates * (delay / period + 0.5))
    stiffness = servo.inertia * w**2
    answer: ComplexArray = ones.astype(np.complex128)
    for _ in range(_ROUNDS if coupled else 1):
        passed = ones
        torque = np.zeros(speed.shape)
        if coupled:
            wall = -(stiffness + spring_of_damper) * turned
            torque = wall.real[:, None] * sine + wall.imag[:, None] * cosine
            size = np.maximum(np.abs(wall), 1e-12)
            share = np.minimum(servo.dead_band / size, 1.0)
            passed = 1.0 - 2.0 / np.pi * (np.arcsin(share) + share * np.sqrt(1.0 - share**2))
            passed = np.maximum(passed, _LEAST)
            torque = torque - np.clip(torque, -servo.dead_band, servo.dead_band)
        against = (servo.coulomb + servo.gear * np.abs(torque)) * np.sign(cosine)
        against = against + servo.drag * speed * np.abs(speed)
        lossy = servo.damping + 2.0 * np.mean(against * cosine, axis=1) / (shaft * w)
        heavy = servo.inertia - 2.0 * np.mean(against * sine, axis=1) / (shaft * w**2)
        heavy = np.maximum(heavy, _LEAST * servo.inertia)
        plant = inverse_plant(np.maximum(lossy, 0.0) * period / heavy, delay / period, rates)
        answer = plant * heavy / period**2 / (gain * passed) - spring_of_damper
        stiffness = 0.5 * (stiffness + np.maximum(answer.real, 0.0))
    return answer
