"""Fits the stiffness at which an oscillation of a given amplitude neither grows nor decays.

Near it the growth per half-cycle is a plane over the logarithm of the stiffness and the inverse of
the amplitude, because the effect of Coulomb friction falls with the amplitude. The plane is fitted
to the half-cycles of all trials, so that trials on either side of the limit bracket it and each of
them counts. What leaving out each trial changes is the uncertainty (jackknife): neighbouring
half-cycles share a turning point, and trials scatter for more reasons than these.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.experiments.sweep.decrement import Growth

_NEAR = 0.25
"""Largest logarithmic distance of fitted trials from the estimate, where they are enough"""
_ENOUGH = 4
"""Least number of trials"""
_CURVED = 5
"""Number of different stiffnesses from which a curvature is fitted"""
_SPREAD = 0.02
"""Least relative spread of the inverse amplitudes for fitting their effect"""
_STRETCH = 1.05
"""Largest extrapolation of the growth beyond the observed amplitudes"""
_LEVEL = 0.2
"""Least slope of the growth at its zero, relative to that at the guess"""
_FADED = 0.35
"""Fraction of the wanted amplitude below which friction and noise dominate"""


@dataclass(frozen=True, slots=True)
class Trial:
    """Result of one release at one stiffness."""

    stiffness: float
    """[N·m/rad]"""
    growth: Growth
    half_period: float
    """[s]; NaN: too few turning points"""
    grew: bool
    """Whether the motion grew; by its end where its growth is not known"""


@dataclass(frozen=True, slots=True)
class Balance:
    """The stiffness with zero growth."""

    stiffness: float
    """[N·m/rad]"""
    uncertainty: float
    """One standard error [N·m/rad]"""
    frequency: float
    """[Hz]"""
    amplitude: float
    """Amplitude for which it holds [rad]"""
    low: float
    """Softest and ..."""
    high: float
    """... stiffest trial near it [N·m/rad]"""


def balance(trials: Sequence[Trial], kick: float, guess: float) -> Balance | None:
    """Fit the growth of all trials near the balance and find its zero.

    Args:
        trials: Trials of any stiffness.
        kick: Wanted amplitude [rad].
        guess: Approximate stiffness [N·m/rad].

    Returns:
        None where trials do not determine it: too few half-cycles, or growth that does not rise
            with the stiffness.
    """
    usable = [trial for trial in trials if trial.growth.log_ratio.size]
    estimate = None
    for _ in range(3):
        ordered = sorted(usable, key=lambda trial: abs(math.log(trial.stiffness / guess)))
        near = [t for t in ordered if abs(math.log(t.stiffness / guess)) < _NEAR]
        near = near if len(near) > _ENOUGH else ordered[:_ENOUGH]
        zero = _zero(near, kick, guess)
        parts = [_zero(near[:n] + near[n + 1 :], kick, guess) for n in range(len(near))]
        left = np.array([part[0] for part in parts if part is not None])
        if zero is None or len(left) < _ENOUGH - 1:
            return estimate
        away, amplitude = zero
        n = len(left)
        error = math.sqrt((n - 1) / n * float(np.sum((left - left.mean()) ** 2)))
        stiffness = guess * math.exp(away)
        stiffnesses = [trial.stiffness for trial in near]
        estimate = Balance(
            stiffness=stiffness,
            uncertainty=stiffness * error,
            frequency=_frequency(near, stiffness),
            amplitude=amplitude,
            low=min(stiffnesses),
            high=max(stiffnesses),
        )
        if abs(away) < 0.01:
            break
        guess = stiffness
    return estimate


def _zero(trials: Sequence[Trial], kick: float, guess: float) -> tuple[float, float] | None:
    """Return log(stiffness without growth / guess), and the amplitude.

    The trials come in order of their distance from the guess. None: they do not tell it.
    """
    if len({trial.stiffness for trial in trials}) < 2:
        return None
    nearest = np.concatenate([trial.growth.amplitude for trial in trials[:_ENOUGH]])
    reached = float(np.clip(kick, nearest.min() / _STRETCH, nearest.max() * _STRETCH))
    size = [trial.growth.log_ratio.size for trial in trials]
    x = np.repeat([math.log(trial.stiffness / guess) for trial in trials], size)
    inverse = reached / np.concatenate([trial.growth.amplitude for trial in trials]) - 1.0
    value = np.concatenate([trial.growth.log_ratio for trial in trials])
    lasting = inverse <= 1.0 / _FADED - 1.0
    x, inverse, value = x[lasting], inverse[lasting], value[lasting]
    curved = len(set(x.tolist())) >= _CURVED
    by_amplitude = x.size > 0 and float(np.ptp(inverse)) > _SPREAD
    terms = [np.ones(x.size), x]
    terms += [x * x] if curved else []
    terms += [inverse] if by_amplitude else []
    matrix = np.column_stack(terms)
    if matrix.shape[0] < matrix.shape[1] + 2:
        return None
    found, *_ = np.linalg.lstsq(matrix, value, rcond=None)
    root = _root(found[0], found[1], found[2] if curved else 0.0)
    return None if root is None else (root, reached)


def _root(constant: float, slope: float, bend: float) -> float | None:
    """Return the nearest upward zero of the growth to the guess; None: none is near."""
    if slope <= 0.0:
        return None
    squared = slope * slope - 4.0 * bend * constant
    if squared <= (_LEVEL * slope) ** 2:  # the curvature is only noise: use the straight line
        x = -constant / slope
    else:
        x = -2.0 * constant / (slope + math.sqrt(squared))
    return float(x) if abs(x) < 1.5 else None


def _frequency(trials: Sequence[Trial], stiffness: float) -> float:
    """Return the oscillation's frequency at a stiffness [Hz], by a line between logarithms."""
    known = [trial for trial in trials if np.isfinite(trial.half_period)]
    if not known:
        return float("nan")
    x = np.log([trial.stiffness / stiffness for trial in known])
    y = np.log([0.5 / trial.half_period for trial in known])
    if np.ptp(x) < 1e-3:
        return float(np.exp(np.mean(y)))
    return float(np.exp(np.polyfit(x, y, 1)[1]))
