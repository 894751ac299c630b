"""Fits a servo to a motion of its own, with those effects of a real servo that the motion shows.

The guard's model comes first. Where it does not explain the motion every effect is fitted too, and
those that the motion does not need are taken out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from haptic_wall.controller.experiments.identify.fit import NAMES, Fit
from haptic_wall.controller.experiments.identify.fitting import (
    begun,
    fitted,
    model_of,
    rounding_of,
    visible_backlash,
)
from haptic_wall.controller.experiments.identify.motion import Motion, taken
from haptic_wall.controller.experiments.identify.output_error import Prior
from haptic_wall.controller.experiments.identify.separable import standard_covariance
from haptic_wall.controller.theory.checks import FloatArray

FADING = ("excess", "fading")
COGGING = ("cogging_sine", "cogging_cosine", "periods")
ALWAYS: tuple[tuple[str, ...], ...] = (
    ("gear",),
    ("uneven",),
    ("drag",),
    ("dead_band",),
    ("sine", "cosine"),
)
"""Effects that are always tried, each with the names of its values"""
EVERY = tuple(name for group in ALWAYS for name in group)
"""The names of all of these values"""
ROUGH = ("gear", "dead_band", "sine", "cosine")
"""Effects without which an inertia can be far off"""
_RATIOS = np.concatenate([np.arange(1.0, 2.0, 0.05), np.arange(2.0, 4.05, 0.1)])
"""Tried ratios of friction at rest to friction in slow motion"""
_STICKS = 0.95
"""Largest fraction of the squares that more friction at rest must leave"""
_LOADED, _LEFT, _BETTER = 1.2, 1.1, 0.9
"""Residual without noise, over the rounding's, from which effects are fitted; residual over the
noise that they need not explain; and the largest fraction of the residual that they may leave where
a backlash explains it too"""
_TRIMS, _OUTLIER = 3, 3.0
"""Number of times that pieces are omitted, and the outlier limit in medians of the residuals"""
_DOUBTFUL = (1.5, 3.0)
"""Standard errors below which an effect is taken out: at first, and in the end"""
_NEEDED = 1.002
"""Residual without friction that fades, over that with it, from which the motion needs it"""
_HINT = 3.5
"""Standard errors from which an effect that was not fitted must be"""
_SURE = 30.0
"""Least gain of an effect that is not always tried, over the variance of independent samples"""
_FADES = 1.8
"""Speed over which friction fades, where it is looked for [rad/s]"""
_PERIODS = (3, 201)
"""Tried periods of the cogging in a turn; with fewer it is like a weight"""

Priors = Mapping[str, Prior]


def fit_servo(
    motion: Motion, step: float, priors: Priors | None = None, *, rough: bool = False
) -> Fit:
    """Fit the model, and the effects of a real servo where the motion has them.

    Args:
        motion: A motion; the shaft moves for at least two seconds.
        step: One count of the encoder [rad]; 0: not quantised.
        priors: Prior knowledge of values, by name.
        rough: The fit is for scaling other motions.

    Raises:
        NoFitError: The motion is not sufficient.
    """
    start = begun(motion, step)
    if rough:
        return fitted(start.having(ROUGH), priors, thorough=False)
    plain = fitted(start)
    # Neglected backlash looks like delay: half a count like a third of a millisecond.
    plain = visible_backlash(plain) or plain
    noise = rounding_of(step)
    explained = plain.smooth_part(noise) <= _LOADED * noise
    hints = _hinted(plain) if explained else ()
    if explained and not hints:
        return plain
    fit = _loaded(motion, hints or EVERY, step, priors, hinted=bool(hints))
    return plain if fit.residual > _BETTER * plain.residual and plain["backlash"] else fit


def _loaded(
    motion: Motion, names: tuple[str, ...], step: float, priors: Priors | None, *, hinted: bool
) -> Fit:
    """Return the fit with effects.

    Args:
        motion: As ``fit_servo``.
        names: Names of the effects that are tried.
        step: As ``fit_servo``.
        priors: As ``fit_servo``.
        hinted: No others are looked for.
    """

    def unexplained(fit: Fit) -> bool:
        return fit.residual > _LEFT * max(fit.noise, rounding_of(step))

    # In one direction every effect is nearly linear in its size.
    moving = fitted(begun(motion, step, turns=False).having(names), priors)
    if not hinted:
        moving = _with_fading(_with_cogging(moving, priors), priors)
    start = begun(motion, step)
    fit = replace(moving, pieces=start.pieces, own=start.own)
    fit = fitted(fit, priors, thorough=False)
    if unexplained(fit):
        fit = visible_backlash(fit, priors, thorough=False) or fit
    if unexplained(fit):
        fit = _trimmed(_with_stiction(fit, priors), _LEFT * fit.noise, priors)
    if unexplained(fit):  # what the shaft does at rest is left out
        fit = min(fit, moving, key=lambda each: each.residual)
    for least in _DOUBTFUL:
        kept = _needed(fit, least)
        if kept != fit.effects:
            fit = fitted(_only(fit, kept), priors, thorough=False)
    fit = fitted(fit, priors)
    if not fit["backlash"]:
        fit = visible_backlash(fit, priors) or fit
    return _without_doubtful_fading(fit, priors)


def _is_sure(before: Fit, after: Fit) -> bool:
    """Return whether effects explain more than chance does."""
    sure = _SURE * (before.noise / before.residual) ** 2 / np.count_nonzero(before.pieces.held)
    return bool((after.residual / before.residual) ** 2 < 1.0 - sure)


def _with_fading(fit: Fit, priors: Priors | None) -> Fit:
    """Return the fit with friction that fades with the speed, where the motion has it."""
    half = 0.5 * fit["coulomb"]
    start = fit.having((*fit.effects, *FADING), coulomb=half, excess=half, fading=_FADES)
    found = fitted(start, priors, thorough=False)
    brakes = fit.weaker[0] > 0.0
    return fit if brakes and not _is_sure(fit, found) else found


def _with_cogging(fit: Fit, priors: Priors | None) -> Fit:
    """Return the fit with cogging, where the motion has it."""
    center = float(np.median(fit.pieces.position))
    explained, sine, cosine, periods = _cogging(fit, center)
    if explained < _SURE * fit.noise**2:
        return fit
    start = fit.having(
        (*fit.effects, *COGGING),
        center=center,
        cogging_sine=sine,
        cogging_cosine=cosine,
        periods=periods,
    )
    found = fitted(start, priors, thorough=False)
    return found if _is_sure(fit, found) else fit


def _cogging(fit: Fit, center: float) -> tuple[float, float, float, float]:
    """Return the cogging that explains most: these squares [rad²], two sizes [N·m], and periods."""
    model = model_of(fit, (*NAMES[:4], *fit.effects), None)
    linear = model.linear(model.begin, fit.own)
    weights = linear.weights
    interval = float(np.median(np.diff(fit.pieces.motion.sampled)))

    def rest(lines: FloatArray) -> FloatArray:
        means = np.sum(weights * lines, axis=2) / np.sum(weights, axis=1)
        found = np.sqrt(weights) * linear.without_own(lines - means[:, :, None])
        return found.reshape(len(lines), -1)

    known = np.linalg.qr(rest(linear.shared).T)[0]
    left = rest(linear.left[None])[0]
    best = (0.0, 0.0, 0.0, 0.0)
    for periods in range(*_PERIODS):
        angle = periods * (fit.pieces.position - center)
        torques = np.stack([np.sin(angle), np.cos(angle)])
        waves = rest(np.cumsum(np.cumsum(torques, axis=2), axis=2) * interval**2)
        waves = waves - (waves @ known) @ known.T
        target = waves @ left
        sizes = np.linalg.lstsq(waves @ waves.T, target, rcond=1e-9)[0]
        sine, cosine = (fit["inertia"] * sizes).tolist()
        best = max(best, (float(target @ sizes), sine, cosine, float(periods)))
    return best


def _without_doubtful_fading(fit: Fit, priors: Priors | None) -> Fit:
    """Return the fit without an excess that the motion does not need.

    Such friction hides viscous friction, whose upper bound contains it still; the lower one is that
    without, because friction does not grow at low speeds.
    """
    if "drag" not in fit.names:
        return fit
    if "excess" not in fit.names:
        return replace(fit, least=_least(fit))
    if fit["excess"] > _DOUBTFUL[1] * fit.error("excess"):
        return fit
    kept = tuple(name for name in fit.effects if name not in FADING)
    without = fitted(_only(fit, kept), priors, thorough=False)
    if without.residual > _NEEDED * fit.residual or sum(without.weaker) < 0.0:
        return fit  # no servo's friction falls with the speed but by fading
    return replace(without, least=max(_least(without), _least(fit)))


def _least(fit: Fit) -> float:
    value, error = fit.weaker
    return max(value - _DOUBTFUL[1] * error, 0.0)


def _hinted(fit: Fit) -> tuple[str, ...]:
    """Return the effects with which a fit without them would be better, by a step from its end.

    Each is tried by itself, because beside all others none may seem to be needed.
    """
    model = model_of(fit, (*NAMES[:4], *EVERY), None)
    linear = model.linear(model.begin, fit.own)
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


def _only(fit: Fit, names: tuple[str, ...]) -> Fit:
    """Return the fit without the effects that are not named."""
    return fit.having(names, **{name: 0.0 for name in fit.effects if name not in names})


def _needed(fit: Fit, least: float) -> tuple[str, ...]:
    """Return the names of the effects that the motion needs.

    Friction that fades and the drag beside it are always kept: they cancel each other over the
    speed, so that neither seems to be needed where both are. The gear's friction counts as inertia
    where it is left out, so that it goes only where it is below the first number of errors.
    """
    kept: list[str] = []
    for group in (*ALWAYS, COGGING, FADING):
        sized = [name for name in group if name not in ("periods", "fading")]
        if group[0] not in fit.names:
            continue
        fades = "excess" in fit.names and group in (FADING, ("drag",))
        size = math.hypot(*(fit[name] for name in sized))
        errors = min(least, _DOUBTFUL[0]) if group == ("gear",) else least
        if fades or size > errors * fit.error(*sized):
            kept += group
    return tuple(kept)


def _with_stiction(fit: Fit, priors: Priors | None) -> Fit:
    """Return the fit with the friction at rest that leaves the smallest residual."""
    model = model_of(fit, (*NAMES[:4], *fit.effects), priors)
    slow = fit["coulomb"] + max(fit["excess"], 0.0)
    costs = model.costs("static", _RATIOS * slow, fit.own)
    lowest = int(np.argmin(costs))
    if float(costs[lowest]) > _STICKS * float(costs[0]):
        return fit
    start = fit.having(static=float(_RATIOS[lowest]) * slow)
    return fitted(start, priors, thorough=False)


def _trimmed(fit: Fit, explained: float, priors: Priors | None) -> Fit:
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
        fewer = replace(fit, pieces=taken(pieces, kept), own=fit.own[:, kept])
        fit = fitted(fewer, priors, thorough=False)
    return fit
