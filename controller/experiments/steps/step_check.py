"""Checks whether a fit of torque steps is credible: impossible values, and non-rigid motion.

The fitted motion is that of one mass under a torque step. A flexible transmission lets the
encoder's side ring after each step, and the fit then gives a wrong lag with a small scatter. Two
signs show it: residuals above the noise from sample to sample, and residuals with the same course
after every step. A load whose vibration is known is part of the fitted motion.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from haptic_wall.controller.experiments.steps.step_fit import (
    FEWEST_STEPS,
    StepFit,
    fit_steps,
    residuals,
)
from haptic_wall.controller.experiments.steps.torque_steps import Step
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.errors import Problem

ROUGH = 1.25
"""Largest ratio of residuals to noise (rms): up to 1.1 on servos with stiction, cogging, gravity,
backlash, or a current that takes 10 ms; from 1.3 on with a flexible transmission below 50 Hz, on
either side of which the encoder may be."""
KNOWN = 1.5
"""The same where the load's vibration is counted: its frequency has an error"""
COURSE = 2.0
"""Largest common course of the residuals, in standard errors: a rigid servo exceeds it three times
in a million, one with a mode below 100 Hz nearly always."""
_BINS = 12
_WINDOWS = (0.7, 0.5)
"""Fractions of the samples about a step for repeated fits of the lag"""
_BELOW = 2e-4
"""Most negative plausible lag [s]: cogging and friction at rest may cause that much"""
_SURE = 3.0
"""Standard errors from which a value is impossible"""
_UNKNOWN = 0.01
"""Least standard error of the lag that means that nothing was found [s]"""


def fault(fit: StepFit, longest: float) -> Problem | None:
    """Return why a fit cannot be used; None: it can.

    Args:
        fit: Fit of all steps.
        longest: Longest lag of the search [s].
    """
    ratio = fit.residual / noise(fit.steps)
    error, lag = fit.stderr, f"the lag would be {1e3 * fit.lag:.3g} ± {1e3 * fit.stderr:.2g} ms"
    most = ROUGH if fit.steps[0].mode is None else KNOWN
    if ratio > most:
        found = (
            f"it differs from the fitted motion by {ratio:.3g} times the noise of the samples,"
            f" wanted at most {most:g} times"
        )
    elif not error < _UNKNOWN:
        found = f"{lag}, wanted an error below {1e3 * _UNKNOWN:g} ms"
    elif not -max(_BELOW, _SURE * error) <= fit.lag <= longest + _SURE * error:
        found = f"{lag}, wanted one from 0 to {1e3 * longest:.3g} ms"
    elif fit.acceleration <= _SURE * fit.acceleration_stderr:
        found = f"the torque accelerates the shaft by {fit.acceleration:.3g} rad/s² per N·m"
    else:
        return None
    wanted = "a rigid servo" if fit.steps[0].mode is None else "the believed load"
    return Problem(
        f"the motion is not that of {wanted}, and does not determine the lag: {found}",
        advice="check for a loose horn, an elastic link or transmission, and contact with the"
        " shaft",
    )


def doubted(fit: StepFit) -> StepFit:
    """Return the fit with a larger error that covers the choice of samples, where residuals agree.

    A torque that rises slowly, or a stiff transmission, leaves residuals of the same course after
    every step. The lag then depends on the number of fitted samples. The lag cannot be negative:
    the error covers its possible range.
    """
    doubts = [max(-fit.lag - 2.0 * fit.stderr, 0.0)]
    if course(fit) > COURSE:
        lags = [fit_steps(_about(fit, share), fit.lag).lag for share in _WINDOWS]
        doubts += [abs(lag - fit.lag) for lag in lags]
    return replace(fit, systematic=max(fit.systematic, *doubts))


def noise(steps: tuple[Step, ...]) -> float:
    """Return the root mean square of the noise from sample to sample [rad]: mostly rounding.

    It is the distance of each sample from the line through its two neighbours; the acceleration
    adds its own part, which without an encoder step is all.
    """
    squares, count = 0.0, 0
    for step in steps:
        t, x = step.time, step.position
        share = (t[1:-1] - t[:-2]) / (t[2:] - t[:-2])
        off = x[1:-1] - (1.0 - share) * x[:-2] - share * x[2:]
        squares += float(np.sum(off**2 / (1.0 + (1.0 - share) ** 2 + share**2)))
        count += off.size
    return float(np.sqrt(squares / count))


def course(fit: StepFit) -> float:
    """Return the size of the residuals' common course, in its standard errors.

    Each step's residuals, in the direction of its change of torque, are averaged over intervals of
    time since it acted; over the steps these means are about zero where the fit is right. The
    result is the root of the mean square of their t values, reduced to a variance of 1.
    """
    count = len(fit.steps)
    times = [step.time - fit.lag for step in fit.steps]
    first, last = np.percentile(np.concatenate(times), [2.0, 98.0])
    means = np.full((count, _BINS), np.nan)
    for i, (step, time, rest) in enumerate(
        zip(fit.steps, times, residuals(fit.steps, fit.values), strict=True)
    ):
        place = np.floor(_BINS * (time - first) / (last - first)).astype(int)
        inside = (place >= 0) & (place < _BINS)
        samples = np.bincount(place[inside], minlength=_BINS)
        sums = np.bincount(place[inside], rest[inside], minlength=_BINS)
        some = samples > 0
        means[i, some] = np.sign(step.after - step.before) * sums[some] / samples[some]
    return _common(means)


def _common(means: FloatArray) -> float:
    squares = []
    for column in means.T:
        known = column[np.isfinite(column)]
        spread = float(np.var(known, ddof=1)) if known.size >= FEWEST_STEPS else 0.0
        if spread > 0.0:
            t = float(np.mean(known)) ** 2 * known.size / spread
            squares.append(t * (known.size - 3) / (known.size - 1))
    return float(np.sqrt(np.mean(squares))) if squares else 0.0


def _about(fit: StepFit, share: float) -> list[Step]:
    """Return the steps with only the samples nearest to the change."""
    found = []
    for step in fit.steps:
        time = step.time - fit.lag
        near = (time >= share * time[0]) & (time <= share * time[-1])
        found.append(replace(step, time=step.time[near], position=step.position[near]))
    return found
