"""Removes the effect of angle-dependent torques from the motion of torque steps.

The torque of a weight and of cogging depends on the angle. The steps occur at similar angles again
and again, so that such a torque is mistaken for lag. The positions are measured, so the course of
the torque is known except its size. Per unit inertia it has moved the shaft, within the window of a
step, by its integral taken twice::

    L(t) = integral of integral of w(x(t)),    w = sin x, cos x, sin N x, cos N x

L neglects damping, which within a window of some ten milliseconds changes it by less than the
friction's uncertainty. The sizes are fitted with the lag by least squares.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.experiments.steps.step_check import ROUGH, noise
from haptic_wall.controller.experiments.steps.step_fit import (
    GAIN,
    LAG,
    Samples,
    StepFit,
    covariance_of,
    fit_steps,
    jacobian_of,
    scale_of,
)
from haptic_wall.controller.experiments.steps.torque_steps import Step
from haptic_wall.controller.theory.checks import FloatArray

EXPLAINED = 1.01
"""Largest ratio of residuals to noise (rms) at which no load is searched"""
_PERIODS = range(4, 201, 2)
"""Tried cogging periods in a turn"""
_WEIGHT, _COGGING = 1.5, 2.0
"""Least reduction of the squares by a weight, and by additional cogging, in units of a mean step's
squares"""
_ROUNDS = 2


class _Measured(NamedTuple):
    """The measured steps, and their fit without loads."""

    samples: Samples
    values: FloatArray
    rest: FloatArray
    """Residuals of all samples [rad]"""
    jacobian: FloatArray
    """Jacobian of the residuals, shape (samples, 4)"""


class _Found(NamedTuple):
    """A least squares solution."""

    left: float
    """Remaining sum of the squares [rad²]"""
    sizes: FloatArray
    """Accelerations per wave [rad/s²]"""
    columns: FloatArray
    """Derivatives of the samples' residuals by values and sizes, shape (samples, 4 + sizes)"""
    rest: FloatArray
    """Residuals of the samples [rad]"""


def without_loads(fit: StepFit) -> StepFit:
    """Repeat the fit with the effect of a weight or cogging removed, if one is visible.

    Its uncertainty is part of the systematic error of the lag.

    Args:
        fit: Fit of the measured motion.

    Returns:
        The new fit. The fit itself if rounding explains its residuals, or if they are larger than
        any weight causes: then there is another fault, which waves would only hide.
    """
    if not EXPLAINED < fit.residual / noise(fit.steps) <= ROUGH:
        return fit
    measured = _measured(fit.steps, fit.values)
    waves = _waves(measured)
    if not waves:
        return fit
    free = fit
    for _ in range(_ROUNDS):
        found = _solved(_measured(fit.steps, free.values), waves)
        free = fit_steps(_freed(fit.steps, waves, found.sizes), free.lag)
    found = _solved(_measured(fit.steps, free.values), waves)
    ends = np.cumsum([step.time.size for step in fit.steps])
    joint = covariance_of(found.columns, np.split(found.rest, ends[:-1]))
    more = max(float(joint[LAG, LAG] - free.covariance[LAG, LAG]), 0.0)
    return replace(free, systematic=math.sqrt(more))


def _waves(measured: _Measured) -> list[float]:
    """Return the number of periods in a turn of each visible wave; 1 is a weight."""
    one = float(measured.rest @ measured.rest) / measured.samples.sizes.size
    least = _solved(measured, [1.0]).left
    waves = [1.0]
    if measured.rest @ measured.rest - least < _WEIGHT * one:
        waves, least = [], float(measured.rest @ measured.rest)
    cogged = {n: _solved(measured, [*waves, n]).left for n in map(float, _PERIODS)}
    periods = min(cogged, key=cogged.__getitem__)
    if least - cogged[periods] >= _COGGING * one:
        waves.append(periods)
    return waves


def _measured(steps: tuple[Step, ...], values: FloatArray) -> _Measured:
    scale = scale_of(steps, abs(float(values[GAIN])))
    samples = Samples.of(steps)
    jacobian = jacobian_of(samples, values, scale)
    return _Measured(samples, values, samples.residuals(values), jacobian)


def _solved(measured: _Measured, waves: list[float]) -> _Found:
    """Fit the sizes of waves together with the values."""
    samples = measured.samples
    loads = samples.without_start(measured.values, _moved(samples, waves))
    columns = np.concatenate([measured.jacobian, -loads.T], axis=1)
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    solution = np.linalg.lstsq(columns / scale, -measured.rest, rcond=None)[0] / scale
    rest = measured.rest + columns @ solution
    return _Found(float(rest @ rest), solution[4:], columns, rest)


def _freed(steps: Sequence[Step], waves: list[float], sizes: FloatArray) -> list[Step]:
    """Return the steps with the effect of the waves removed."""
    samples = Samples.of(steps)
    freed = np.split(samples.position - sizes @ _moved(samples, waves), samples.begins[1:])
    return [replace(step, position=each) for step, each in zip(steps, freed, strict=True)]


def _moved(samples: Samples, waves: list[float]) -> FloatArray:
    """Return the motion that each wave of size 1 causes [s²], shape (2 per wave, samples)."""
    angles = np.outer(waves, samples.position)
    pushed = np.concatenate([np.sin(angles), np.cos(angles)])
    return _integrated(samples, _integrated(samples, pushed))


def _integrated(samples: Samples, values: FloatArray) -> FloatArray:
    """Integrate values over time, from the first sample of each step on."""
    lengths = np.diff(samples.time, prepend=0.0)
    lengths[samples.begins] = 0.0
    before = np.concatenate([values[:, :1], values[:, :-1]], axis=1)
    whole: FloatArray = np.cumsum(0.5 * (values + before) * lengths, axis=1)
    integral: FloatArray = whole - np.repeat(whole[:, samples.begins], samples.sizes, axis=1)
    return integral
