"""Fits inertia, friction and delay of a real servo, and effects that the guard's model lacks.

The start is the fit of motion in one direction, which says what effects there may be. All of them
are simulated through the turns, and those that the motion does not need are taken out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from haptic_wall.controller.experiments.identify.effects import (
    ALWAYS,
    COGGING,
    FADING,
)
from haptic_wall.controller.experiments.identify.fitting import (
    NAMES,
    Fit,
    fitted,
    model_of,
    on_motion,
    visible_backlash,
)
from haptic_wall.controller.experiments.identify.motion import Motion, taken
from haptic_wall.controller.experiments.identify.output_error import Prior
from haptic_wall.controller.experiments.identify.standard_errors import standard_covariance

_RATIOS = np.concatenate([np.arange(1.0, 2.0, 0.05), np.arange(2.0, 4.05, 0.1)])
"""Tried ratios of friction at rest to friction in slow motion"""
_STICKS = 0.95
"""Largest fraction of the squares that more friction at rest must leave"""
_LEFT, _UNQUANTISED = 1.1, 1e-5
"""Residual that is explained: as a multiple of that in one direction; at least this [rad]"""
_FEW = 20
"""Least number of stretches in one direction"""
_TRIMS, _OUTLIER = 3, 3.0
"""Number of times that pieces are omitted, and the outlier limit in medians of the residuals"""
_DOUBTFUL = (1.5, 3.0)
"""Standard errors below which an effect is taken out: at first, and in the end"""
_NEEDED = 1.002
"""Residual without friction that fades, over that with it, from which the motion needs it"""
_HINT = 3.5
"""Standard errors from which an effect that was not fitted must be"""


def fit_loaded(
    motion: Motion,
    step: float,
    start: Fit,
    priors: Mapping[str, Prior] | None = None,
    hints: tuple[str, ...] = (),
) -> Fit:
    """Fit the model together with the effects of a real servo.

    Args:
        motion: A motion; the shaft moves for at least two seconds.
        step: One count of the encoder [rad]; 0: not quantised.
        start: Fit of the motion in one direction, with the effects to be tried.
        priors: Prior knowledge of values, by name.
        hints: The only effects that are tried; none: every one.

    Raises:
        NoFitError: The motion is not sufficient.
    """
    explained = _LEFT * max(start.residual, _UNQUANTISED)
    begun = on_motion(start, motion, step)
    tried = replace(begun.effects, fitted=hints)
    begun = replace(begun, effects=tried) if hints else _every_effect(begun)
    fit = fitted(begun, priors, thorough=False)
    if fit.residual > explained:
        fit = visible_backlash(fit, priors, thorough=False) or fit
    if fit.residual > explained:
        fit = _trimmed(_with_stiction(fit, priors), explained, priors)
    if fit.residual > explained and start.pieces.position.shape[0] >= _FEW:
        # What the shaft does at rest is left out.
        sticking = replace(fit.effects, errors={})
        moving = replace(
            fit, pieces=start.pieces, speeds=start.speeds, effects=sticking, backlash=0.0
        )
        moving = fitted(moving, priors, thorough=False)
        fit = min(fit, moving, key=lambda each: each.residual)
    for least in _DOUBTFUL:
        kept = _needed(fit, least)
        if kept != fit.effects.fitted:
            fit = fitted(_only(fit, kept), priors, thorough=False)
    fit = fitted(fit, priors)
    if not fit.backlash:
        fit = visible_backlash(fit, priors) or fit
    return _without_doubtful_fading(fit, priors)


def _without_doubtful_fading(fit: Fit, priors: Mapping[str, Prior] | None) -> Fit:
    """Return the fit without an excess that the motion does not need.

    Such friction hides viscous friction, whose upper bound contains it still; the lower one is that
    without, because friction does not grow at low speeds.
    """
    effects = fit.effects
    if "drag" not in effects.fitted:
        return fit
    if "excess" not in effects.fitted:
        return replace(fit, least=_least(fit))
    if effects.excess > _DOUBTFUL[1] * effects.error("excess"):
        return fit
    kept = tuple(name for name in effects.fitted if name not in FADING)
    without = fitted(_only(fit, kept), priors, thorough=False)
    if without.residual > _NEEDED * fit.residual:
        return fit
    least = max(_least(without), _least(fit))
    value, error = without.weaker
    return replace(without, weaker=(max(value, least), error), least=least)


def _least(fit: Fit) -> float:
    value, error = fit.weaker
    return max(value - _DOUBTFUL[1] * error, 0.0)


def hinted(fit: Fit) -> tuple[str, ...]:
    """Return the effects with which a fit without them would be better, by a step from its end.

    Each is tried by itself, because beside all others none may seem to be needed.
    """
    every = _every_effect(fit)
    model = model_of(every, (*NAMES[:4], *every.effects.fitted), None)
    linear = model.linear(model.begin, every.speeds[None])
    period = float(np.median(np.diff(fit.pieces.motion.sampled)))
    found: list[str] = []
    for group in ALWAYS:
        used = [model.names.index(name) for name in (*NAMES[:4], *group)]
        one = replace(linear, shared=linear.shared[used], precision=np.zeros(len(used)))
        step = one.step()
        moved = one.left + np.tensordot(step, one.shared, axes=1)
        after = replace(one, left=one.without_own(moved[None])[0])
        errors = np.sqrt(np.diag(standard_covariance(after, period)))
        if np.any(np.abs(step[4:]) > _HINT * errors[4:]):
            found += group
    return tuple(found)


def _every_effect(fit: Fit) -> Fit:
    """Return the fit with every effect that is always tried among those to be fitted."""
    names = dict.fromkeys([*(n for group in ALWAYS for n in group), *fit.effects.fitted])
    return replace(fit, effects=replace(fit.effects, fitted=tuple(names)))


def _only(fit: Fit, names: tuple[str, ...]) -> Fit:
    """Return the fit without the effects that are not named."""
    gone = {name: 0.0 for name in fit.effects.fitted if name not in names}
    return replace(fit, effects=replace(fit.effects, fitted=names, errors={}, **gone))


def _needed(fit: Fit, least: float) -> tuple[str, ...]:
    """Return the names of the effects that the motion needs.

    Friction that fades and the drag beside it are always kept: they cancel each other over the
    speed, so that neither seems to be needed where both are.
    """
    effects = fit.effects
    kept: list[str] = []
    for group in (*ALWAYS, COGGING, FADING):
        sized = [name for name in group if name not in ("periods", "fading")]
        if group[0] not in effects.fitted:
            continue
        fades = "excess" in effects.fitted and group in (FADING, ("drag",))
        size = math.hypot(*(getattr(effects, name) for name in sized))
        if fades or size > least * effects.error(*sized):
            kept += group
    return tuple(dict.fromkeys(kept))


def _with_stiction(fit: Fit, priors: Mapping[str, Prior] | None) -> Fit:
    """Return the fit with the friction at rest that leaves the smallest residual."""
    model = model_of(fit, (*NAMES[:4], *fit.effects.fitted), priors)
    slow = fit.coulomb + max(fit.effects.excess, 0.0)
    costs = model.costs("static", _RATIOS * slow, fit.speeds[None])
    lowest = int(np.argmin(costs))
    if float(costs[lowest]) > _STICKS * float(costs[0]):
        return fit
    static = float(_RATIOS[lowest]) * slow
    return fitted(replace(fit, effects=replace(fit.effects, static=static)), priors, thorough=False)


def _trimmed(fit: Fit, explained: float, priors: Mapping[str, Prior] | None) -> Fit:
    """Return the fit without outlier pieces: a shaft that nearly sticks may move or not.

    Args:
        fit: Fit of all pieces.
        explained: Residual at which no piece is omitted [rad].
        priors: As for the fit.
    """
    for _ in range(_TRIMS):
        pieces = fit.pieces
        squares = np.where(pieces.held, (fit.fitted - pieces.position) ** 2, 0.0)
        each = np.sqrt(squares.sum(axis=1) / pieces.held.sum(axis=1))
        kept = each <= max(_OUTLIER * float(np.median(each)), explained)
        if np.all(kept):
            break
        fewer = replace(fit, pieces=taken(pieces, kept), speeds=fit.speeds[kept])
        fit = fitted(fewer, priors, thorough=False)
    return fit
