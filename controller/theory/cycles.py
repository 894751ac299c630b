"""Predicts limit cycles by harmonic balance: saturation, encoder, backlash or friction at a wall.

To a sinusoid of amplitude A a nonlinearity in the loop is a gain N(A), complex where it lags. An
oscillation sustains itself where ``1 + N(A) L(e^{j w}) = 0``. The loop L is exact, sampled and
delayed; only the harmonics of the oscillation are neglected, which the inertia filters.

Predictions and simulations agree to a few per cent for backlash, and to 10 % for saturation without
a damper. With a damper a saturated wall has many cycles, up to thirteen times as large as predicted
and at a third of the frequency. Cycles of about a count agree roughly, and some that are listed as
stable above the limit do not persist. Quantised walls also rattle where no cycle is predicted.

The place of the nonlinearity decides what it multiplies. A quantised position, backlash before the
encoder and a saturated torque all multiply the whole wall, K and B together; Coulomb friction is an
extra damping of the plant (see ``friction``). Each prediction has one nonlinearity only.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.theory.chain import one_mass, sampled
from haptic_wall.controller.theory.checks import (
    ComplexArray,
    FloatArray,
    not_negative,
    number,
    positive,
    samples,
    scalar,
)
from haptic_wall.controller.theory.crossings import Loops, poles
from haptic_wall.controller.theory.describing import (
    backlash_gain,
    quantisation_gain,
    saturation_gain,
)
from haptic_wall.controller.theory.friction import onset_amplitude
from haptic_wall.controller.theory.loop import HeldLoop
from haptic_wall.controller.theory.roots import dips, zeros

Gain = Callable[[FloatArray], NDArray[np.inexact]]

_LARGEST = 64.0  # counts: above it a quantiser's gain is 1 within 0.002
_WIDEST, _TABLE = 1e7, 40_000  # backlash widths: above it the lag is less than 1e-7
_NO_GAIN = -700.0  # as a logarithm
_OUTSIDE = 1 + 1e-7


class LimitCycle(NamedTuple):
    """A self-sustained oscillation."""

    amplitude: float
    """Half of the position's travel from peak to peak [rad]"""
    frequency: float
    """[Hz]"""
    stable: bool
    """To first order, nearby motion converges to it (else it diverges from it)"""


@dataclass(frozen=True, slots=True)
class Coulomb:
    """Coulomb friction on the body."""

    friction: float
    """c [N·m]"""


@dataclass(frozen=True, slots=True)
class Saturation:
    """A torque that is clipped."""

    limit: float
    """[N·m]"""


@dataclass(frozen=True, slots=True)
class Quantisation:
    """A position rounded to the nearest count."""

    step: float
    """One count q [rad]"""
    at_edge: bool = False
    """The motion is centred on the edge between two counts, where a steady push can hold it (else
    on the middle of a count)"""


@dataclass(frozen=True, slots=True)
class Backlash:
    """Backlash between the body and its encoder."""

    width: float
    """Full width [rad]"""


def limit_cycles(
    inertia: float,
    damping: float,
    stiffness: float,
    virtual_damping: float,
    period: float,
    delay: float,
    effect: Coulomb | Saturation | Quantisation | Backlash,
    velocity_samples: int = 1,
) -> list[LimitCycle]:
    """Return the limit cycles of a two-sided wall with one nonlinearity, the smallest first.

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous damping b >= 0 [N·m·s/rad].
        stiffness: K > 0 [N·m/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        effect: The nonlinearity.
        velocity_samples: N of the velocity difference, >= 1.

    Returns:
        Every predicted cycle, stable or unstable. An empty list does not promise rest: a quantised
        wall may still rattle by less than a count.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    m, b = scalar(positive, "inertia", inertia), scalar(not_negative, "damping", damping)
    k, big_b = (
        scalar(positive, "stiffness", stiffness),
        scalar(number, "virtual_damping", virtual_damping),
    )
    t, t_d = scalar(positive, "period", period), scalar(not_negative, "delay", delay)
    n = int(scalar(samples, "velocity_samples", velocity_samples))
    if isinstance(effect, Coulomb):
        onset = onset_amplitude(m, b, effect.friction, k, big_b, t, t_d, n)
        amplitude = float(onset.amplitude)
        if not 0 < amplitude < math.inf:
            return []
        return [LimitCycle(amplitude, float(onset.frequency), stable=False)]
    plant = HeldLoop.of(*(np.asarray(x, dtype=np.float64) for x in (b * t / m, t_d / t, n)))
    whole, one = int(plant.delay), np.ones(1)
    chain, _ = one_mass(1.0, plant.delta)
    loops = Loops(sampled(chain, one, np.array([plant.delay - whole])), one, whole, n)
    loop = _Loop(plant, loops, k * t**2 / m, big_b * t / m)
    if isinstance(effect, Backlash):
        positive("width", effect.width)
        found = _lagging(loop, lambda a: backlash_gain(a, 1.0))
        unit = effect.width
    elif isinstance(effect, Quantisation):
        positive("step", effect.step)
        edge = effect.at_edge
        found = _in_phase(loop, lambda a: quantisation_gain(a, 1.0, at_edge=edge), _LARGEST + 1)
        unit = effect.step
    else:
        positive("limit", effect.limit)
        found = _in_phase(loop, lambda a: saturation_gain(a, 1.0), 1e9)
        unit = effect.limit * t**2 / m
        found = [(a / abs(loop.wall(w)), w, stable) for a, w, stable in found]
    cycles = [LimitCycle(a * unit, w / (2 * math.pi * t), stable) for a, w, stable in found]
    return sorted(cycles)


class _Loop(NamedTuple):
    """A wall on its device, dimensionless."""

    plant: HeldLoop
    loops: Loops
    """The same, whose poles are asked for"""
    alpha: float
    beta: float

    def wall(self, w: float) -> complex:
        """Return the torque per position at ``w`` [rad/sample]."""
        return complex(self.alpha + self.beta * self.plant.difference(np.array(w)))

    def needed(self, w: FloatArray) -> ComplexArray:
        """Return the gain N with 1 + N L = 0 at ``w`` [rad/sample]."""
        result: ComplexArray = self.plant.inverse_plant(w) / (
            self.alpha + self.beta * self.plant.difference(w)
        )
        return result

    def comes_back(self, gain: Gain, a: float, w: float) -> bool:
        """Whether a disturbed oscillation (a, w) returns to itself.

        To first order the growth of a disturbance follows the amplitude with the slope Im(N_a /
        -needed_w). In addition no other mode may grow at the oscillation's gain.
        """
        da, dw = 1e-6 * a, 1e-6 * w
        slope = (gain(np.array(a + da)) - gain(np.array(a - da))) / (2 * da)
        turn = (self.needed(np.array(w + dw)) - self.needed(np.array(w - dw))) / (2 * dw)
        if complex(-slope / turn).imag >= 0:
            return False
        now = complex(gain(np.array(a)))
        gains = np.array([now if now.imag else now.real])
        (found,) = poles(self.loops, gains * self.alpha, gains * self.beta)
        # a lagging gain applies to the modes that turn forwards
        found = found[found.imag > -1e-9]
        others = np.delete(found, np.argmin(np.abs(found - np.exp(1j * w))))
        return bool(np.all(np.abs(others) < _OUTSIDE))


def _in_phase(loop: _Loop, gain: Gain, largest: float) -> list[tuple[float, float, bool]]:
    """Return cycles (amplitude, rad/sample, stable) with a real gain; amplitude in steps.

    Their frequencies are those at which the needed gain is real and positive.
    """

    def out_of_phase(w: FloatArray) -> FloatArray:
        return loop.needed(w).imag

    w = zeros(out_of_phase, _grid(out_of_phase, loop))
    w = w[loop.needed(w).real > 0]
    # fine enough for the ripples of a quantiser, which have kinks at every half count
    counts = np.arange(0.5, _LARGEST, 0.5)[:, None]
    amplitudes = (counts + 0.5 * np.linspace(0, 1, 24, endpoint=False) ** 3).ravel()
    amplitudes = np.concatenate([np.geomspace(1e-3, 0.5, 200, endpoint=False), amplitudes])
    amplitudes = np.append(amplitudes, np.geomspace(_LARGEST, largest, 400))
    found = []
    for x in w.tolist():
        n = float(loop.needed(np.array(x)).real)
        for a in zeros(lambda y, n=n: gain(y).real - n, amplitudes).tolist():  # type: ignore[misc]
            found.append((a, x, loop.comes_back(gain, a, x)))
    return found


def _lagging(loop: _Loop, gain: Gain) -> list[tuple[float, float, bool]]:
    """Return cycles with a gain that lags, by up to 90° at an amplitude of half a width."""
    # from half a width on, where the output begins to follow
    sizes = 0.5 + np.geomspace(1e-9, _WIDEST, _TABLE)
    gains = gain(sizes)
    lags, logs = np.angle(gains), np.log(np.abs(gains))

    def excess(w: FloatArray) -> FloatArray:
        """Return the needed gain over the available one, as a logarithm.

        Outside the angles that the gain can have it continues to 1 at no lag and to 0 at 90°: near
        the limit the cycle lies between the last grid point with a lag and the next.
        """
        needed = loop.needed(w)
        lag = np.angle(needed)
        lagging = (lag > lags[0]) & (lag < lags[-1])
        size = np.where(lag >= lags[-1], 0.0, _NO_GAIN)
        size[lagging] = np.interp(lag[lagging], lags, logs)
        result: FloatArray = np.log(np.abs(needed)) - size
        return result

    w = zeros(excess, _grid(excess, loop))
    lag = np.angle(loop.needed(w))
    amplitudes = np.interp(lag, lags, sizes, left=np.nan, right=np.nan)
    return [
        (a, x, loop.comes_back(gain, a, x))
        for a, x in zip(amplitudes.tolist(), w.tolist(), strict=True)
        if math.isfinite(a)
    ]


def _grid(function: Callable[[FloatArray], FloatArray], loop: _Loop) -> FloatArray:
    """Return frequencies between which ``function`` changes its sign at most once."""
    count = 400 + 64 * int(loop.plant.delay + loop.plant.samples)
    fine = np.geomspace(1e-5, 3e-2, 600, endpoint=False)
    grid = np.concatenate([fine, np.linspace(3e-2, np.pi, count, endpoint=False)])
    return np.sort(np.append(grid, dips(function, grid[None], function(grid[None]))))
