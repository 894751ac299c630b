"""Fits an ordinary servo: external loads on its shaft are fitted together with the model.

It adds a weight first; then the cogging that reduces the residual most; then the friction at rest
that leaves the smallest residual. The guard's model has none of them: fitted separately, they
cannot be mistaken for inertia, friction or delay.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter, savgol_filter

from haptic_wall.controller.experiments.identify.fitting import (
    NAMES,
    Fit,
    cuts_of,
    fitted,
    smoothed,
    start_of,
    torque_on,
    visible_backlash,
    window_of,
)
from haptic_wall.controller.experiments.identify.loads import Loads
from haptic_wall.controller.experiments.identify.motion_model import (
    Motion,
    Pieces,
    pieces_of,
    taken,
)
from haptic_wall.controller.experiments.identify.output_error import OutputError, weights_of
from haptic_wall.controller.theory.checks import FloatArray

MOST_PERIODS = 200
"""Largest number of cogging periods in a turn"""
_RATIOS = np.concatenate([np.arange(1.0, 2.0, 0.05), np.arange(2.0, 4.05, 0.1)])
"""Tried ratios of friction at rest to friction in motion"""
_FADINGS = (0.0, 0.03, 0.1, 0.3, 1.0, 3.0)
"""Tried speeds over which that excess fades [rad/s]"""
_FADES = 0.97
"""Largest fraction of the squares that fading must leave to be accepted"""
_LOWER = 0.7
"""Initial fraction of the friction that remains at high speed"""
_LEFT, _UNQUANTISED = 1.1, 1e-5
"""Least residual for a search of fading: as a multiple of the rounding's; and in [rad]"""
_SURE_OF_STICTION = 0.95
"""Largest fraction of the squares that more friction at rest must leave to be reported"""
_KNOWN = 1.2
"""Largest multiple of the residual at which earlier loads still explain the motion"""
_TRIMS, _OUTLIER = 3, 3.0
"""Number of times that pieces are omitted, and the outlier limit in medians of the residuals"""
_ROUNDS = 5
_BETTER = 0.98
"""Largest fraction of the squares that another round, or a cogging, must leave"""
_NEAR = 3.0
"""Distance in periods per turn within which two coggings cannot be distinguished"""


def fit_loaded(motion: Motion, step: float, before: Fit | None = None) -> Fit:
    """Fit the model together with the loads of an ordinary servo.

    Args:
        motion: At least two seconds in which the shaft moves.
        step: One count of the encoder [rad]; 0: not quantised.
        before: Fit of another motion of the same servo: its loads are tried first.

    Raises:
        NoFitError: The motion is not sufficient.
    """
    speed, acceleration = smoothed(motion)
    cuts = cuts_of(motion, speed, max(step, 1e-6))
    pieces = pieces_of(motion, cuts)
    speeds = np.array([speed[begin] for begin, _ in cuts])
    explained = _LEFT * max(step / math.sqrt(12.0), _UNQUANTISED)
    known: tuple[Fit, FloatArray] | None = None
    if before is not None and before.loads is not None:
        known = fitted(pieces, _restarted(before), speeds, with_backlash=False, thorough=False)
        known = _trimmed(*known, explained)
    if known is None or known[0].residual > _KNOWN * explained:
        start = _weighed_start(motion, speed, acceleration)
        found = _searched(start, pieces, speeds)
        if found[0].residual > explained:
            found = _trimmed(*_with_fading(*found), explained)
        if known is None or found[0].residual < known[0].residual:
            known = found
    fit, speeds = known
    played = visible_backlash(fit, speeds) if fit.residual > explained else None
    return played or _without_doubtful_stiction(fit, speeds)


def _without_doubtful_stiction(fit: Fit, speeds: FloatArray) -> Fit:
    """Return the fit without excess friction at rest, where that improves nothing."""
    assert fit.loads is not None
    model = OutputError(fit.pieces, np.array([getattr(fit, n) for n in NAMES[:4]]), fit.loads)
    tried = np.tile(model.begin, (2, 1))
    tried[1, 4] = fit.coulomb
    with_it, without = model.costs(tried, speeds).tolist()
    if with_it < _SURE_OF_STICTION * without:
        return fit
    return replace(fit, loads=replace(fit.loads, static=fit.coulomb, fading=0.0))


def _trimmed(fit: Fit, speeds: FloatArray, explained: float) -> tuple[Fit, FloatArray]:
    """Return the fit without outlier pieces: a shaft that nearly sticks may move or not.

    Args:
        fit: Of all pieces.
        speeds: Of each.
        explained: Residual at which no piece is omitted [rad].
    """
    for _ in range(_TRIMS):
        pieces = fit.pieces
        squares = np.where(pieces.held, (fit.fitted - pieces.position) ** 2, 0.0)
        each = np.sqrt(squares.sum(axis=1) / pieces.held.sum(axis=1))
        kept = each <= max(_OUTLIER * float(np.median(each)), explained)
        if np.all(kept):
            break
        pieces = taken(pieces, kept)
        fit, speeds = fitted(
            pieces, _restarted(fit), speeds[kept], with_backlash=False, thorough=False
        )
    return fitted(fit.pieces, _restarted(fit), speeds, with_backlash=False)


def _restarted(fit: Fit) -> Fit:
    """Return the fit as a new start, with the cogging's period corrected."""
    assert fit.loads is not None
    return replace(fit, loads=fit.loads.settled())


def _searched(start: Fit, pieces: Pieces, speeds: FloatArray) -> tuple[Fit, FloatArray]:
    """Return the fit with friction at rest and cogging, and the speeds of its pieces."""
    fit, speeds = fitted(pieces, start, speeds, with_backlash=False, thorough=False)
    for _ in range(_ROUNDS):
        before = fit.residual
        stuck = _with_stiction(fit, speeds)
        fit, speeds = fitted(pieces, stuck, speeds, with_backlash=False, thorough=False)
        begun = _with_cogging(fit)
        cogged, its_speeds = fitted(pieces, begun, speeds, with_backlash=False, thorough=False)
        if cogged.residual**2 < _BETTER * fit.residual**2:
            fit, speeds = cogged, its_speeds
        if fit.residual**2 > _BETTER * before**2:
            break
    return fitted(pieces, _with_stiction(fit, speeds), speeds, with_backlash=False)


def _with_fading(fit: Fit, speeds: FloatArray) -> tuple[Fit, FloatArray]:
    """Return the fit with friction that fades over a range of speeds, where that is better."""
    assert fit.loads is not None
    best = fit, speeds
    for fading in _FADINGS[1::2]:
        loads = replace(fit.loads, static=fit.coulomb, fading=fading)
        begun = replace(fit, coulomb=_LOWER * fit.coulomb, loads=loads)
        found = fitted(fit.pieces, begun, speeds, with_backlash=False, thorough=False)
        if found[0].residual ** 2 < _BETTER * best[0].residual ** 2:
            best = found
    return best if best[0] is fit else fitted(fit.pieces, best[0], best[1], with_backlash=False)


def _weighed_start(motion: Motion, speed: FloatArray, acceleration: FloatArray) -> Fit:
    """Return the start of the fit as ``start_of``, with a weight."""
    plain = start_of(motion, speed, acceleration)
    moving = np.abs(speed) > 0.15 * np.max(np.abs(speed))
    middle = 0.5 * float(np.min(motion.position) + np.max(motion.position))
    loads = Loads(plain.coulomb, 0.0, middle)
    window = window_of(motion)
    smooth = [savgol_filter(wave, window, 3) for wave in loads.waves(motion.position)]
    columns = np.column_stack([acceleration, speed, np.sign(speed), *smooth])[moving]
    torque = torque_on(motion, [plain.delay])[0][moving]
    found = np.linalg.lstsq(columns, torque, rcond=None)[0].tolist()
    inertia, damping, coulomb = (max(v, 0.05 * plain.inertia) for v in found[:3])
    loads = replace(loads, static=coulomb, weights=tuple(found[3:]))
    return replace(plain, inertia=inertia, damping=damping, coulomb=coulomb, loads=loads)


def _with_cogging(fit: Fit) -> Fit:
    """Return the fit with the cogging that improves it most, or with its own one refined.

    To small torques the body responds as one without Coulomb friction, from the beginning of its
    piece on; effects of the initial state are not counted.
    """
    pieces, loads = fit.pieces, fit.loads
    assert loads is not None
    period = float(np.median(np.diff(pieces.motion.sampled)))
    kept = math.exp(-fit.damping / fit.inertia * period)
    push = 0.5 * period**2 / fit.inertia
    root = np.sqrt(weights_of(pieces))
    time = pieces.sampled - pieces.sampled[:, :1]
    own = np.stack([np.ones(time.shape), time, time**2])
    base = np.linalg.qr(np.moveaxis(own * root, 0, 2))[0]

    def told(shown: FloatArray) -> FloatArray:
        shown = shown * root
        shown = shown - np.einsum("sni,si->sn", base, np.einsum("sni,sn->si", base, shown))
        return shown.ravel()

    def effects(loads: Loads) -> FloatArray:
        waves = -loads.waves(pieces.position)[2:4]
        shown = lfilter([push, push], [1.0, -1.0 - kept, kept], waves)
        return np.stack([told(each) for each in shown], axis=1)

    target = told(pieces.position - fit.fitted)
    if loads.periods:
        target = target + effects(loads) @ np.array(loads.weights[2:4])
    most, best = 0.0, loads
    for periods in range(2, MOST_PERIODS + 1, 2):
        tried = replace(loads, periods=float(periods), weights=(*loads.weights[:2], 0.0, 0.0))
        columns = effects(tried)
        weights = np.linalg.lstsq(columns, target, rcond=1e-6)[0]
        explained = float(np.sum((columns @ weights) ** 2))
        if explained > most:
            found = (*loads.weights[:2], *weights.tolist(), 0.0)
            most, best = explained, replace(tried, weights=found)
    if loads.periods and abs(best.periods - loads.periods) <= _NEAR:
        best = loads.settled()
    return replace(fit, loads=best)


def _with_stiction(fit: Fit, speeds: FloatArray) -> Fit:
    """Return the fit with the friction at rest, and its fading, of the smallest residual."""
    loads = fit.loads
    assert loads is not None
    begin = np.array([getattr(fit, name) for name in NAMES[:4]])
    model = OutputError(fit.pieces, begin, loads)
    at = begin.size
    best, least = (loads.static, loads.fading), math.inf
    fadings = _FADINGS if loads.fading == 0.0 else (0.0, loads.fading)
    for fading in fadings:
        ratios = _RATIOS if fading in (0.0, loads.fading) else _RATIOS[::4]
        tried = np.tile(model.begin, (ratios.size, 1))
        tried[:, at] = ratios * fit.coulomb
        tried[:, at + 1] = fading
        if fading and fading != loads.fading:  # the friction at high speed was part of the mean
            tried[:, 2] = fit.coulomb
        costs = model.costs(tried, speeds)
        lowest = int(np.argmin(costs))
        if float(costs[lowest]) < (_FADES if fading else 1.0) * least:
            least, best = float(costs[lowest]), (float(tried[lowest, at]), fading)
    return replace(fit, loads=replace(loads, static=best[0], fading=best[1]))
