"""Fits the stiffness at which an oscillation of a given amplitude neither grows nor decays.

Near it the growth per half-cycle is a plane over the logarithm of the stiffness and the inverse of
the amplitude, because the effect of Coulomb friction falls with the amplitude. The plane is fitted
to the half-cycles of all trials, so that trials on either side of the limit bracket it and each of
them counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.experiments.sweep.decrement import Growth
from haptic_wall.controller.theory.checks import FloatArray

_NEAR = (0.1, 0.25)
"""Largest logarithmic distances of fitted trials from the estimate: the smaller where they are
enough, because growth is curved over the stiffness"""
_ENOUGH = 4
"""Least number of different stiffnesses"""
_CURVED = 5
"""Number of different stiffnesses from which a curvature is fitted"""
_SPREAD = 0.02
"""Least relative spread of the inverse amplitudes for fitting their effect"""
_DRIFT = 0.1
"""Part of a half-cycle's error that is independent; the rest comes from two turning points, and is
shared with its neighbours."""
_STRETCH = 1.05
"""Largest extrapolation of the growth beyond the observed amplitudes"""
_BESIDE = 4
"""Number of trials nearest to the guess that define the observed amplitudes"""
_LEVEL = 0.2
"""Least slope of the growth at its zero, relative to that at the guess"""
_TOLD = 3.0
"""Standard errors by which the growth must depend on the amplitude"""
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
    larger_grows: bool | None = None
    """At this stiffness larger motion grows, as with friction (true), or decays, as in a cycle that
    backlash sustains (false); None: the trials do not tell"""


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
        near = _near(usable, guess)
        if len({trial.stiffness for trial in near}) < 2:
            return estimate
        zero = _zero(near, kick, guess)
        if zero is None:
            return estimate
        stiffness, error, amplitude, larger_grows = zero
        found = [_without(near, left, kick, guess) for left in range(len(near)) if len(near) > 3]
        spread = np.array([value for value in found if value is not None])
        # Delete one trial at a time (jackknife): the scatter of repeats, whatever its cause.
        if spread.size > 2:
            n = spread.size
            again = float(np.sqrt((n - 1) / n * np.sum((spread - spread.mean()) ** 2)))
            error = max(error, again)
        stiffnesses = [trial.stiffness for trial in near]
        estimate = Balance(
            stiffness=stiffness,
            uncertainty=error,
            frequency=_frequency(near, stiffness),
            amplitude=amplitude,
            low=min(stiffnesses),
            high=max(stiffnesses),
            larger_grows=larger_grows,
        )
        if abs(np.log(stiffness / guess)) < 0.01:
            break
        guess = stiffness
    return estimate


def _near(trials: Sequence[Trial], guess: float) -> list[Trial]:
    """Return the trials nearest to the guess, of at least ``_ENOUGH`` stiffnesses."""
    ordered = sorted(trials, key=lambda trial: abs(math.log(trial.stiffness / guess)))
    near: list[Trial] = []
    for distance in _NEAR:
        near = [t for t in ordered if abs(math.log(t.stiffness / guess)) < distance]
        if len({trial.stiffness for trial in near}) >= _ENOUGH:
            return near
    return near if len(near) > _ENOUGH else ordered[:_ENOUGH]


def _without(trials: Sequence[Trial], left: int, kick: float, guess: float) -> float | None:
    zero = _zero([trial for n, trial in enumerate(trials) if n != left], kick, guess)
    return None if zero is None else zero[0]


def _zero(
    trials: Sequence[Trial], kick: float, guess: float
) -> tuple[float, float, float, bool | None] | None:
    """Return the stiffness without growth, its standard error, its amplitude, and larger motion.

    The trials come in order of their distance from the guess.
    """
    amplitudes = np.concatenate([trial.growth.amplitude for trial in trials[:_BESIDE]])
    reached = float(np.clip(kick, amplitudes.min() / _STRETCH, amplitudes.max() * _STRETCH))
    amplitudes = np.concatenate([trial.growth.amplitude for trial in trials])
    inverse = reached / amplitudes[amplitudes >= _FADED * reached] - 1.0
    curved = len({trial.stiffness for trial in trials}) >= _CURVED
    by_amplitude = float(np.ptp(inverse)) > _SPREAD
    rows, values = [], []
    for trial in trials:
        away = math.log(trial.stiffness / guess)
        growth = _lasting(trial.growth, _FADED * reached)
        n = growth.log_ratio.size
        if n == 0:
            continue
        terms = [np.ones(n), np.full(n, away)]
        if curved:
            terms.append(np.full(n, away * away))
        if by_amplitude:
            terms.append(reached / growth.amplitude - 1.0)
        whiten = _whitening(growth)
        rows.append(whiten @ np.column_stack(terms))
        values.append(whiten @ growth.log_ratio)
    if not rows:
        return None
    matrix, value = np.concatenate(rows), np.concatenate(values)
    if matrix.shape[0] < matrix.shape[1] + 2:
        return None
    found, *_ = np.linalg.lstsq(matrix, value, rcond=None)
    rest = value - matrix @ found
    variance = float(rest @ rest) / (matrix.shape[0] - matrix.shape[1])
    covariance = variance * np.linalg.pinv(matrix.T @ matrix)
    root = _root(found[0], found[1], found[2] if curved else 0.0)
    if root is None:
        return None
    x = root
    gradient = np.zeros(found.size)
    gradient[:2] = 1.0, x
    if curved:
        gradient[2] = x * x
    slope = found[1] + (2.0 * found[2] * x if curved else 0.0)
    error = float(np.sqrt(gradient @ covariance @ gradient) / slope)
    stiffness = guess * float(np.exp(x))
    larger = None
    if by_amplitude and abs(found[-1]) > _TOLD * math.sqrt(covariance[-1, -1]):
        larger = bool(found[-1] < 0.0)
    return stiffness, error * stiffness, reached, larger


def _lasting(growth: Growth, least: float) -> Growth:
    keep = growth.amplitude >= least
    return Growth(growth.log_ratio[keep], growth.amplitude[keep], growth.number[keep])


def _root(constant: float, slope: float, bend: float) -> float | None:
    """Return the nearest upward zero of the growth to the guess; None: none is near."""
    if slope <= 0.0:
        return None
    squared = slope * slope - 4.0 * bend * constant
    if squared <= (_LEVEL * slope) ** 2:  # the curvature is only noise: use the straight line
        x = -constant / slope
    else:
        x = -2.0 * constant / (slope + math.sqrt(squared))
    return x if abs(x) < 1.5 else None


def _whitening(growth: Growth) -> FloatArray:
    """Return the matrix that makes the errors of a trial's half-cycles independent, shape (n, n).

    Neighbours share an amplitude: its error increases the one and decreases the other.
    """
    n = growth.number.size
    covariance = (1.0 + _DRIFT) * np.eye(n)
    together = np.flatnonzero(np.diff(growth.number) == 1)
    covariance[together, together + 1] = covariance[together + 1, together] = -0.5
    result: FloatArray = np.linalg.inv(np.linalg.cholesky(covariance))
    return result


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
