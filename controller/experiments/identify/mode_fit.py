"""Fits the vibration of two masses to cruises: frequency, damping ratio and inertia, with bounds.

Motor and load, with the transmission between them, turn the encoder's side by ::

    J y'' = u          and      z'' + 2 zeta w z' + w² z = u / J,      position = y - z

with J of both masses, whatever their ratio: the encoder is on the output. While the shaft cruises
friction adds a slow course, so each cruise has a polynomial of its own, and a vibration that was
there before. All of it is linear but the frequency, the damping ratio and the delay.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.experiments.identify.fit import Fit
from haptic_wall.controller.experiments.identify.motion import Motion
from haptic_wall.controller.theory.checks import ComplexArray, FloatArray

_FINE = 4
"""Steps of the simulated torque in a period"""
_DEGREE = 4
"""Of the polynomial of a cruise"""
_SETTLED_S = 0.02
"""Left out at the beginning of a cruise [s]"""
Sample = TypeVar("Sample", np.float64, np.complex128)
FEWEST = 80
"""Least samples of a cruise"""
_LIGHTEST, _HEAVIEST = 0.6, 1.7
"""Range of 1 / J over that of other motions"""
_RIDGE, _NOTHING = 1e-10, 1e-300
"""Keep columns that are alike apart, relative to their squares; stands for no square"""
LAGS_S = (0.0, 0.5e-3, 1.0e-3)
"""Time constants of the current loop that may be there unknown"""


@dataclass(frozen=True, slots=True)
class Cruises:
    """Cruises on even grids: arrays of p cruises with n samples, padded with zeros."""

    position: FloatArray
    """Shape (p, n) [rad]"""
    weights: FloatArray
    """1 for a sample, 0 for padding and lost ones"""
    time: FloatArray
    """From the beginning of each cruise [s], shape (n,)"""
    torque: FloatArray
    """That acts, in steps of a quarter period from the beginning, shape (p, 4 n) [N·m]"""
    period: float
    """[s]"""
    decay: float
    """Viscous friction over inertia [1/s]"""


def cruises_of(
    motion: Motion,
    spans: Sequence[tuple[float, float, float]],
    period: float,
    fit: Fit,
) -> Cruises:
    """Return the cruises of a motion.

    Args:
        motion: The recorded motion.
        spans: Begin and end of each cruise [s], and its way.
        period: [s].
        fit: Fit of other motions: its dead band and its friction by the gear's load are taken from
            the torque.
    """
    positions, weights, torques = [], [], []
    delay, dead, gear = (max(fit[name], 0.0) for name in ("delay", "dead_band", "gear"))
    cumulative = np.concatenate([[0.0], np.cumsum(motion.torque[:-1] * np.diff(motion.sent))])
    for begin, end, way in spans:
        kept = (motion.sampled >= begin + _SETTLED_S) & (motion.sampled < end)
        if np.count_nonzero(kept) < FEWEST:
            continue
        sampled, position = motion.sampled[kept], motion.position[kept]
        first = float(sampled[0])
        index = np.rint((sampled - first) / period).astype(int)
        count = int(index[-1]) + 1
        at = first + period * np.arange(count)
        held = np.zeros(count)
        held[index] = 1.0
        positions.append(np.interp(at, sampled, position) - position[0])
        weights.append(held)
        edges = first - delay + period / _FINE * np.arange(_FINE * count + 1)
        impulse = np.interp(edges, motion.sent, cumulative)
        torque = np.diff(impulse) / (period / _FINE)
        torque = torque - np.clip(torque, -dead, dead)
        torques.append(torque - way * gear * np.abs(torque))
    longest = max((len(each) for each in positions), default=0)

    def padded(parts: list[FloatArray], length: int) -> FloatArray:
        found = [np.pad(each, (0, length - each.size)) for each in parts]
        return np.array(found).reshape(-1, length)

    return Cruises(
        padded(positions, longest),
        padded(weights, longest),
        period * np.arange(longest, dtype=np.float64),
        padded(torques, _FINE * longest),
        period,
        max(fit["damping"], 0.0) / fit["inertia"],
    )


@dataclass(frozen=True, slots=True)
class Solved:
    """The linear part of a fit, at given frequency and damping ratio."""

    cost: float
    """Sum of squares [rad²]"""
    gains: FloatArray
    """1 / J of the rigid motion [1/(kg·m²)]; where it is fitted freely also of the vibration"""


class ModeModel:
    """The linear part of the model, for many frequencies and damping ratios.

    Args:
        cruises: The motion.
        inertia: Inertia of motor and load by other motions, roughly [kg·m²].
    """

    def __init__(self, cruises: Cruises, inertia: float) -> None:
        self._gain = 1.0 / inertia
        self._cruises = cruises
        self._fine = cruises.period / _FINE
        span = cruises.time[-1] if cruises.time.size else 1.0
        each = 2.0 * cruises.time / span - 1.0
        self._polynomials = np.polynomial.legendre.legvander(each, _DEGREE)
        self._lagged = {lag: self._torque(lag) for lag in LAGS_S}
        self._rigid = {lag: self._rigid_motion(torque) for lag, torque in self._lagged.items()}

    def solved(
        self,
        hertz: float | None,
        ratio: float = 0.0,
        lag: float = 0.0,
        *,
        free: bool = False,
    ) -> Solved:
        """Return the best fit with a mode; None: with a rigid shaft.

        Args:
            hertz: Frequency, both ends free [Hz].
            ratio: Damping ratio, < 1.
            lag: One of ``LAGS_S`` [s].
            free: The gain of the vibration is fitted; else it is that of two masses.

        Returns:
            The squares are infinite where the inertia is far from that of other motions.
        """
        rigid, speed = self._rigid[lag]
        shared = [rigid]
        nuisance = self._nuisance(hertz, ratio)
        rate = speed
        if hertz is not None:
            mode, its_rate = self._mode(self._lagged[lag], hertz, ratio)
            if free:
                shared.append(mode)
            else:
                shared[0] = rigid - mode
                rate = speed - its_rate
        shared.append(-rate)
        found = self._least_squares(nuisance, shared)
        if hertz is not None and not _LIGHTEST < found.gains[0] / self._gain < _HEAVIEST:
            return replace(found, cost=math.inf)
        return found

    def _torque(self, lag: float) -> FloatArray:
        from scipy.signal import lfilter

        torque = self._cruises.torque
        if lag == 0.0:
            return torque
        kept = math.exp(-self._fine / lag)
        # The mean over a step of the lagging torque, which began at rest long ago.
        start = torque[:, :1] * kept
        found, _ = lfilter([1.0 - kept], [1.0, -kept], torque, axis=1, zi=start)
        result: FloatArray = found
        return result

    def _rigid_motion(self, torque: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return position and speed at the samples, per 1 / J."""
        from scipy.signal import lfilter

        h, decay = self._fine, max(self._cruises.decay, 1e-3)
        kept = math.exp(-decay * h)
        phi = (1.0 - kept) / decay
        psi = (h - phi) / decay
        speed = _before(lfilter([phi], [1.0, -kept], torque, axis=1))
        position = _before(np.cumsum(phi * speed + psi * torque, axis=1))
        return position[:, ::_FINE], speed[:, ::_FINE]

    def _mode(
        self, torque: FloatArray, hertz: float, ratio: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return position and speed of the vibration at the samples, per 1 / J."""
        from scipy.signal import lfilter

        rate, damped = _pole(hertz, ratio)
        kept = np.exp(rate * self._fine)
        parts = (kept - 1.0) / rate * kept ** np.arange(_FINE - 1, -1, -1)
        driven = torque.reshape(torque.shape[0], -1, _FINE) @ parts
        state = _before(lfilter([1.0], [1.0, -(kept**_FINE)], driven, axis=1))
        return state.imag / damped, (rate * state).imag / damped

    def _nuisance(self, hertz: float | None, ratio: float) -> FloatArray:
        """Return the columns that each cruise has by itself, n × q."""
        if hertz is None:
            plain: FloatArray = np.asarray(self._polynomials, np.float64)
            return plain
        rate, _ = _pole(hertz, ratio)
        free: ComplexArray = np.exp(rate * self._cruises.time)
        return np.column_stack([self._polynomials, free.real, free.imag])

    def _least_squares(self, nuisance: FloatArray, shared: list[FloatArray]) -> Solved:
        weights = self._cruises.weights[:, :, None]
        lines = np.stack([self._cruises.position, *shared], axis=2)  # p, n, r
        weighted = weights * nuisance  # p, n, q
        gram = np.swapaxes(weighted, 1, 2) @ nuisance
        scale = np.trace(gram, axis1=1, axis2=2) / gram.shape[1] + _NOTHING
        gram = gram + _RIDGE * scale[:, None, None] * np.eye(gram.shape[1])
        cross = np.swapaxes(weighted, 1, 2) @ lines  # p, q, r
        own = np.linalg.solve(gram, cross)
        square = np.swapaxes(weights * lines, 1, 2) @ lines - np.swapaxes(cross, 1, 2) @ own
        square = square.sum(axis=0)
        size = np.sqrt(np.maximum(np.diag(square)[1:], _NOTHING))
        normal = square[1:, 1:] / np.outer(size, size)
        found = np.linalg.lstsq(normal, square[1:, 0] / size, rcond=1e-12)[0] / size
        return Solved(
            float(square[0, 0] - found @ square[1:, 0]),
            found[:-1],
        )


def _before(values: NDArray[Sample]) -> NDArray[Sample]:
    """Return the values at the beginnings of steps, from those at their ends."""
    return np.concatenate([np.zeros_like(values[:, :1]), values[:, :-1]], axis=1)


def _pole(hertz: float, ratio: float) -> tuple[complex, float]:
    w = math.tau * hertz
    damped = w * math.sqrt(1.0 - ratio**2)
    return complex(-ratio * w, damped), damped
