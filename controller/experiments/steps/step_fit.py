"""Fits lag, acceleration and friction to the motion of all torque steps at once.

While a shaft keeps its direction under a held torque its motion is, per unit inertia, ::

    x(t) = x0 + v0 h(t) + a S(t)        h = (1 - exp(-decay t)) / decay,  S = (t - h) / decay

with ``a = gain u - friction sign(v)``. Around a step, t counts from the instant at which the new
torque begins to act, ``lag`` after it was sent; before it u is the old torque, after it the new
one. ``x0`` and ``v0`` are each step's own, the other four are common to all steps. Where a load is
known to vibrate, its motion is added: the forced one, and a free one that is each step's own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from haptic_wall.controller.experiments.steps.torque_steps import Mode, Step
from haptic_wall.controller.theory.checks import FloatArray

LAG, GAIN, FRICTION, DECAY = range(4)
FEWEST_STEPS = 8
_RESOLUTION = 1e-9
"""Instants are kept in whole nanoseconds [s]."""
_SMALL = 1e-3
_USUAL = 0.25
"""Fraction of a period by which a step's delay from command to sending may differ from the others'
"""
_WIDTH = 1e-4
"""Relative width of the differences for derivatives."""
_ENOUGH = 1e-9
"""Least relative improvement of the squares for another iteration."""


@dataclass(frozen=True, slots=True)
class StepFit:
    """Parameters that fit all steps best."""

    values: FloatArray
    """Lag [s], gain [1/(kg·m²)], friction [rad/s²], decay [1/s]: shape (4,)"""
    covariance: FloatArray
    """Covariance of the values, shape (4, 4); by the scatter from step to step"""
    steps: tuple[Step, ...]
    residual: float
    """Root of the mean square [rad]"""
    systematic: float = 0.0
    """Error of the lag in addition to the scatter [s]"""

    @property
    def lag(self) -> float:
        """Return the time from sending a torque until it acts [s]."""
        return float(self.values[LAG])

    @property
    def stderr(self) -> float:
        """Return the standard error of the lag [s]."""
        return math.hypot(math.sqrt(self.covariance[LAG, LAG]), _RESOLUTION, self.systematic)

    @property
    def acceleration(self) -> float:
        """Return the acceleration per commanded torque [rad/s² per N·m]."""
        return float(self.values[GAIN])

    @property
    def acceleration_stderr(self) -> float:
        """Return the standard error of the acceleration [rad/s² per N·m]."""
        return float(np.sqrt(self.covariance[GAIN, GAIN]))

    @property
    def friction(self) -> float:
        """Return the deceleration by Coulomb friction [rad/s²]."""
        return float(self.values[FRICTION])

    @property
    def decay(self) -> float:
        """Return viscous damping over inertia [1/s]."""
        return float(self.values[DECAY])


@dataclass(frozen=True, slots=True)
class Samples:
    """The samples of several steps, one step after the other: arrays of shape (samples,)."""

    time: FloatArray
    """Since the step was sent [s]"""
    position: FloatArray
    """[rad]"""
    before: FloatArray
    """Torque before the sample's step [N·m]"""
    after: FloatArray
    """Torque after it [N·m]"""
    direction: FloatArray
    """Direction of its motion, 1 or -1"""
    begins: NDArray[np.intp]
    """First sample of each step, shape (steps,)"""
    sizes: NDArray[np.intp]
    """Number of samples of each step, shape (steps,)"""
    mode: Mode | None = None
    """Vibration of the servo; None: it is rigid"""

    @classmethod
    def of(cls, steps: Sequence[Step]) -> Samples:
        """Join the samples of steps."""
        sizes = np.array([step.time.size for step in steps])

        def common(name: str) -> FloatArray:
            return np.repeat([float(getattr(step, name)) for step in steps], sizes)

        return cls(
            np.concatenate([step.time for step in steps]),
            np.concatenate([step.position for step in steps]),
            common("before"),
            common("after"),
            common("direction"),
            np.cumsum(sizes) - sizes,
            sizes,
            steps[0].mode,
        )

    def residuals(self, values: FloatArray) -> FloatArray:
        """Return the residuals with the best initial state of each step [rad].

        Args:
            values: As in ``StepFit``.
        """
        lag, gain, friction, decay = values
        time = self.time - lag
        once, twice = shapes(float(decay), time)
        torque = np.where(time < 0.0, self.before, self.after)
        forced = (gain * torque - friction * self.direction) * twice
        if self.mode is not None:
            forced += gain * (self.after - self.before) * self.mode.forced(time)
        return self._without_line(time, once, self.position - forced)

    def without_start(self, values: FloatArray, motion: FloatArray) -> FloatArray:
        """Return motions without the part that initial positions and velocities explain.

        Args:
            values: As in ``StepFit``.
            motion: Shape (..., samples).
        """
        lag, _, _, decay = values
        time = self.time - lag
        return self._without_line(time, shapes(float(decay), time)[0], motion)

    def _without_line(self, time: FloatArray, once: FloatArray, motion: FloatArray) -> FloatArray:
        if self.mode is not None:
            columns = np.stack([np.ones_like(once), once, *self.mode.free(time)], axis=1)
            rest = motion.copy()
            for first, size in zip(self.begins.tolist(), self.sizes.tolist(), strict=True):
                own = slice(first, first + size)
                basis = np.linalg.qr(columns[own])[0]
                rest[..., own] -= (rest[..., own] @ basis) @ basis.T
            return rest
        away, rest = once - self._mean(once), motion - self._mean(motion)
        spread = self._mean(away**2)
        slope = self._mean(away * rest) / np.where(spread > 0.0, spread, 1.0)
        left: FloatArray = rest - slope * away
        return left

    def _mean(self, values: FloatArray) -> FloatArray:
        """Return the mean over each step, at each of its samples."""
        means = np.add.reduceat(values, self.begins, axis=-1) / self.sizes
        repeated: FloatArray = np.repeat(means, self.sizes, axis=-1)
        return repeated


def fit_steps(steps: Sequence[Step], lag: float) -> StepFit:
    """Fit the motion to all steps at once.

    Args:
        steps: At least ``FEWEST_STEPS`` steps, of both directions.
        lag: Initial guess [s], within about a period.

    Raises:
        ValueError: There are too few steps.
    """
    if len(steps) < FEWEST_STEPS or len({step.direction for step in steps}) < 2:
        raise ValueError(
            f"{len(steps)} usable torque steps, wanted at least {FEWEST_STEPS} of both directions"
        )
    gain = _gain_scale(steps, lag)
    values, jacobian = _least_squares(steps, np.array([lag, gain, 0.0, 0.0]), scale_of(steps, gain))
    left = residuals(steps, values)
    covariance = covariance_of(jacobian, left)
    every = np.concatenate(left)
    return StepFit(values, covariance, tuple(steps), float(np.sqrt(np.mean(every**2))))


def from_command(fit: StepFit, period: float) -> StepFit:
    """Return the fit with the lag counted from the sample of each torque.

    Steps that a stall of the machine has delayed or advanced are omitted: their delay is not that
    of the others.

    Args:
        fit: Fit of the lag from sending.
        period: [s].
    """
    commanded = np.array([step.commanded for step in fit.steps])
    usual = np.abs(commanded - np.median(commanded)) < _USUAL * period
    mean = float(np.mean(commanded[usual]))
    counted = [
        replace(step, time=step.time - step.commanded, commanded=0.0)
        for step, kept in zip(fit.steps, usual, strict=True)
        if kept
    ]
    if np.ptp(commanded) < _RESOLUTION:  # the result would be the same
        shifted = fit.values.copy()
        shifted[LAG] -= mean
        return replace(fit, values=shifted, steps=tuple(counted))
    return replace(fit_steps(counted, fit.lag - mean), systematic=fit.systematic)


def lost_motion(fit: StepFit) -> tuple[float, float] | None:
    """Return the shaft's travel at each reversal that the encoder misses [rad], and its stderr.

    The motions fitted before and after a reversal are extrapolated to it: with backlash, or a
    flexible gear, they differ by that much.

    Returns:
        None where no two steps follow each other.
    """
    gaps = _gaps(fit.steps, fit.values)
    if gaps.size < 2:
        return None
    scatter = float(np.std(gaps, ddof=1) / np.sqrt(gaps.size))
    slope = np.zeros(4)
    for i, width in enumerate(np.sqrt(np.diag(fit.covariance))):
        changed = fit.values.copy()
        changed[i] += width
        slope[i] = (np.mean(_gaps(fit.steps, changed)) - np.mean(gaps)) / width if width else 0.0
    common = math.sqrt(max(float(slope @ fit.covariance @ slope), 0.0))
    return float(np.mean(gaps)), float(np.hypot(scatter, common))


def caused(fit: StepFit) -> tuple[FloatArray, FloatArray]:
    """Return the effect of each step on the motion, per torque: zero until it acts.

    Returns:
        Times since it was sent [s] and distances [rad/(N·m)] of all samples.
    """
    times, motions = [], []
    for step in fit.steps:
        time, once, _ = _parts(step, fit.values)
        position, velocity = _start(step, fit.values)
        _, twice = shapes(fit.decay, time)
        gain, friction = fit.values[GAIN], fit.values[FRICTION]
        without = (gain * step.before - friction * step.direction) * twice
        away = step.position - position - velocity * once - without
        times.append(step.time)
        motions.append(away / (step.after - step.before))
    return np.concatenate(times), np.concatenate(motions)


def shapes(decay: float, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return h [s] and S [s²] at a time [s] of either sign."""
    y = decay * time
    small = np.abs(y) < _SMALL
    safe = decay if decay else 1.0
    once = np.where(small, time * (1 - y / 2 + y * y / 6), -np.expm1(-y) / safe)
    twice = np.where(small, time**2 * (0.5 - y / 6 + y * y / 24), (time - once) / safe)
    return once, twice


def residuals(steps: Sequence[Step], values: FloatArray) -> list[FloatArray]:
    """Return the residuals of each step with its own best initial state [rad].

    Args:
        steps: Any.
        values: As in ``StepFit``.
    """
    samples = Samples.of(steps)
    return np.split(samples.residuals(values), samples.begins[1:])


def jacobian_of(samples: Samples, values: FloatArray, scale: FloatArray) -> FloatArray:
    """Return derivatives of all residuals with respect to the values, shape (samples, 4).

    Args:
        samples: Samples of all steps.
        values: As in ``StepFit``.
        scale: Approximate size of each value, all above 0; from ``scale_of``.
    """
    columns = []
    for i, width in enumerate(_WIDTH * scale):
        up, down = values.copy(), values.copy()
        up[i] += width
        down[i] -= width
        columns.append((samples.residuals(up) - samples.residuals(down)) / (2.0 * width))
    return np.stack(columns, axis=1)


def scale_of(steps: Sequence[Step], gain: float) -> FloatArray:
    """Return the approximate size of each of a fit's values."""
    return np.array([1e-3, gain, gain * abs(steps[0].after), 1.0])


def _least_squares(
    steps: Sequence[Step], values: FloatArray, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the values of the least squares, and their Jacobian.

    The lag stays where most steps have samples on both sides: outside, the fit diverges to lags at
    which a torque has always acted, or never will.
    """
    samples = Samples.of(steps)
    low, high = np.full(4, -np.inf), np.full(4, np.inf)
    low[LAG] = np.median([step.time[0] for step in steps])
    high[LAG] = np.median([step.time[-1] for step in steps])
    # A very large decay overflows; squares that are zero divide.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        found = least_squares(
            samples.residuals,
            values,
            lambda values: jacobian_of(samples, values, scale),
            bounds=(low, high),
            x_scale=scale,
            ftol=_ENOUGH,
            xtol=None,
            gtol=None,
        )
    return found.x, found.jac


def _gain_scale(steps: Sequence[Step], lag: float) -> float:
    """Estimate the acceleration per torque from the curvature after each step."""
    found = []
    for step in steps:
        behind = step.time > lag
        if np.count_nonzero(behind) >= 4:
            columns = np.vander(step.time[behind] - lag, 3)
            curve = np.linalg.lstsq(columns, step.position[behind], rcond=None)[0]
            found.append(2.0 * float(curve[0]) / step.after)
    return max(float(np.median(np.array(found))) if found else 1.0, 1e-6)


def _parts(step: Step, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return time since the torque acts, distance per velocity, by torque, and by friction."""
    lag, gain, friction, decay = values
    time = step.time - lag
    once, twice = shapes(float(decay), time)
    torque = np.where(time < 0.0, step.before, step.after)
    forced: FloatArray = (gain * torque - friction * step.direction) * twice
    if step.mode is not None:
        forced = forced + gain * (step.after - step.before) * step.mode.forced(time)
    return time, once, forced


def _start(step: Step, values: FloatArray) -> tuple[float, float]:
    """Return position [rad] and velocity [rad/s] at the instant at which the new torque acts."""
    time, once, forced = _parts(step, values)
    own = [] if step.mode is None else step.mode.free(time)
    columns = np.stack([np.ones_like(once), once, *own], axis=1)
    solved = np.linalg.lstsq(columns, step.position - forced, rcond=None)[0]
    return float(solved[0]), float(solved[1])


def covariance_of(jacobian: FloatArray, residuals: list[FloatArray]) -> FloatArray:
    """Return the covariance of the common values, from the scatter between the steps.

    Residuals of one step are correlated (they are mostly the encoder's rounding), those of two
    steps are not: the sandwich estimate from the steps' gradients.
    """
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    ends = np.cumsum([part.size for part in residuals])
    width = jacobian.shape[1]
    meat = np.zeros((width, width))
    for end, part in zip(ends, residuals, strict=True):
        gradient = jacobian[end - part.size : end].T @ part
        meat += np.outer(gradient, gradient)
    count = len(residuals)
    found: FloatArray = inverse @ meat @ inverse * (count / max(count - width, 1))
    return found


def _gaps(steps: Sequence[Step], values: FloatArray) -> FloatArray:
    """Return the distances between the motions on both sides of each reversal [rad]."""
    gaps = []
    for first, second in pairwise(steps):
        if first.burst != second.burst or first.direction == second.direction:
            continue
        if abs(first.after - second.before) > 1e-12:
            continue  # a step between them was not usable
        turned = _turn(first, values, first.after)
        returned = _turn(second, values, second.before)
        if turned is not None and returned is not None:
            gaps.append(first.direction * (returned - turned))
    return np.array(gaps)


def _turn(step: Step, values: FloatArray, torque: float) -> float | None:
    """Return the position at which the motion under a torque comes to rest."""
    _, gain, friction, decay = values
    position, velocity = _start(step, values)
    acceleration = gain * torque - friction * step.direction
    ratio = -velocity / acceleration
    argument = decay * ratio
    if argument <= -1.0:
        return None
    time = ratio * (np.log1p(argument) / argument if abs(argument) > 1e-9 else 1.0)
    once, twice = shapes(float(decay), np.array([time]))
    return float(position + velocity * once[0] + acceleration * twice[0])
