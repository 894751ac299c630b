"""A servo's inertia, friction and delay from its motion: output error, with honest standard errors.

The motion is cut at moments of speed into pieces, each with a beginning of its own, so that nothing
that the model does not know adds up for longer than a piece. The least squares start from a
regression on smoothed data, which takes nothing on trust but the model's form.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter, savgol_filter

from controller.experiments.loads import Loads
from controller.experiments.motion_model import (
    Motion,
    Parameters,
    Pieces,
    pieces_of,
    simulated,
)
from controller.experiments.standard_errors import Linear, standard_errors
from controller.theory.checks import FloatArray

PIECE_S = 0.4
"""Length of a piece, about [s]: long beside the servo's oscillations, short beside its drift"""
_STALL = 4.5
"""Periods without a sample at which a piece ends [1]; fewer are lost replies"""
_SMOOTH_S = 0.021
"""Window of the smoothing for the start [s]"""
_LATEST_S = 0.03
"""The longest delay that the start is searched to [s]"""
_RUN = 8
"""A run of so many equal samples counts in full; a longer one counts no more"""
_VISIBLE = 4.0
"""Standard errors of its own that play must be above zero to count"""
_LEAST_PLAY = 1e-6
"""[rad]"""
_SURE = (5e-4, 5e-4, 5e-4, 0.0, 0.0)
"""No value is known better than by this share: rounding is in what the spring answers to as well"""
MOST_PERIODS = 200
"""Of cogging in a turn that are looked for"""
_STATIC_STEP = 0.02
"""Share of the friction by which that at rest is varied"""
_ROUNDS = 40
_EXACT = 1e-7
"""Residual that no encoder knows of [rad]"""
_ENOUGH = 1e-7
"""Share of the squares below which another round is not worth its time"""
NAMES = ("inertia", "damping", "coulomb", "delay", "play")


class NoFitError(Exception):
    """The motion does not hold what the model needs; the message says what is missing."""


@dataclass(frozen=True, slots=True)
class Fit:
    """A model and how well it is known; torques in the unit in which they were sent."""

    inertia: float
    """[kg·m²]"""
    damping: float
    """[N·m·s/rad]"""
    coulomb: float
    """[N·m]"""
    delay: float
    """From a torque's sending to its action [s]"""
    play: float
    """[rad]; 0 where none was fitted"""
    stderr: tuple[float, ...]
    """Of the five, in order; 0 of a play that was not fitted"""
    residual: float
    """Root mean square of measured less fitted position [rad]"""
    pieces: Pieces
    fitted: FloatArray
    """Positions of the model [rad], shape as the pieces'"""
    loads: Loads | None = None
    """None: none were fitted"""


def fit_motion(motion: Motion, step: float) -> Fit:
    """Fit the model; with play between shaft and encoder only where the motion shows it.

    Args:
        motion: At least two seconds in which the shaft moves.
        step: One count of the encoder [rad]; 0: not quantised.

    Raises:
        NoFitError: The motion cannot tell.
    """
    speed, acceleration = smoothed(motion)
    cuts = _cuts(motion, speed, max(step, 1e-6))
    start = _start(motion, speed, acceleration)
    pieces = pieces_of(motion, cuts)
    speeds = np.array([speed[begin] for begin, _ in cuts])
    without, speeds = _fitted(pieces, start, speeds, with_play=False)
    # Play not counted with passes for delay: half a count of it for a third of a millisecond.
    begun = replace(without, play=max(2.0 * without.residual, _LEAST_PLAY))
    with_play, _ = _fitted(pieces, begun, speeds, with_play=True)
    return with_play if with_play.play > _VISIBLE * with_play.stderr[4] + _LEAST_PLAY else without


def fit_loaded(motion: Motion, step: float) -> Fit:
    """Fit the model with the loads of an ordinary servo besides.

    Args:
        motion: As for ``fit_motion``.
        step: One count of the encoder [rad]; 0: not quantised.

    Raises:
        NoFitError: The motion cannot tell.
    """
    speed, acceleration = smoothed(motion)
    cuts = _cuts(motion, speed, max(step, 1e-6))
    start = _loaded_start(motion, speed, acceleration)
    pieces = pieces_of(motion, cuts)
    speeds = np.array([speed[begin] for begin, _ in cuts])
    fit, speeds = _fitted(pieces, start, speeds, with_play=False)
    fit, speeds = _fitted(pieces, _with_cogging(fit), speeds, with_play=False)
    for _ in range(3):
        fit, speeds = _fitted(pieces, _with_stiction(pieces, fit, speeds), speeds, with_play=False)
    return fit


def _loaded_start(motion: Motion, speed: FloatArray, acceleration: FloatArray) -> Fit:
    """As ``_start``, the loads among the columns."""
    plain = _start(motion, speed, acceleration)
    moving = np.abs(speed) > 0.15 * np.max(np.abs(speed))
    middle = 0.5 * float(np.min(motion.position) + np.max(motion.position))
    loads = Loads(plain.coulomb, middle)
    window = _window(motion)
    smooth = [savgol_filter(wave, window, 3) for wave in loads.waves(motion.position)]
    columns = np.column_stack([acceleration, speed, np.sign(speed), *smooth])[moving]
    torque = torque_on(motion, [plain.delay])[0][moving]
    found = np.linalg.lstsq(columns, torque, rcond=None)[0].tolist()
    inertia, damping, coulomb = (max(v, 0.05 * plain.inertia) for v in found[:3])
    loads = replace(loads, static=coulomb, weights=tuple(found[3:]))
    return replace(plain, inertia=inertia, damping=damping, coulomb=coulomb, loads=loads)


def _with_cogging(fit: Fit) -> Fit:
    """The fit with that cogging begun that would explain most of what it leaves."""
    pieces, loads = fit.pieces, fit.loads
    assert loads is not None
    period = float(np.median(np.diff(pieces.motion.sampled)))
    left = pieces.position - fit.fitted
    weights = _weights(pieces)
    decay = math.exp(-fit.damping / fit.inertia * period)
    answer = [0.5 * period**2 / fit.inertia, 0.5 * period**2 / fit.inertia], [1.0, -1.0 - decay, decay]
    time = pieces.sampled - pieces.sampled[:, :1]
    own = np.stack([np.ones(time.shape), time, np.exp(-fit.damping / fit.inertia * time), time**2])
    root = np.sqrt(weights)
    base = np.linalg.qr(np.moveaxis(own * root, 0, 2))[0]

    def free(x: FloatArray) -> FloatArray:
        x = x * root
        return x - np.einsum("sni,si->sn", base, np.einsum("sni,sn->si", base, x))

    target = free(left)
    best, found = 0.0, (loads.periods, (0.0, 0.0))
    for periods in range(2, MOST_PERIODS + 1, 2):
        tried = replace(loads, periods=float(periods), weights=(0.0,) * 4)
        waves = lfilter(*answer, -tried.waves(pieces.position)[2:], axis=-1)
        columns = np.stack([free(wave).ravel() for wave in waves], axis=1)
        weight = np.linalg.lstsq(columns, target.ravel(), rcond=1e-6)[0]
        explained = float(np.sum((columns @ weight) ** 2))
        if explained > best:
            best, found = explained, (float(periods), tuple(weight.tolist()))
    weights_now = (*loads.weights[:2], *found[1], 0.0)
    return replace(fit, loads=replace(loads, periods=found[0], weights=weights_now))


def _window(motion: Motion) -> int:
    period = float(np.median(np.diff(motion.sampled)))
    return max(5, 2 * round(0.5 * _SMOOTH_S / period) + 1)


def _with_stiction(pieces: Pieces, fit: Fit, speeds: FloatArray) -> Fit:
    """The fit with the friction at rest that leaves least of the motion, its cogging settled."""
    assert fit.loads is not None
    fit = replace(fit, loads=fit.loads.settled())
    ratios = np.concatenate([np.arange(1.0, 2.0, 0.05), np.arange(2.0, 3.05, 0.1)])
    model = _Model(pieces, fit.play > 0.0, fit)
    tried = np.tile(model.begin, (ratios.size, 1))
    tried[:, model.count] = ratios * fit.coulomb
    best = float(tried[int(np.argmin(model.costs(tried, speeds))), model.count])
    assert fit.loads is not None
    return replace(fit, loads=replace(fit.loads, static=best))


def smoothed(motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Speed [rad/s] and acceleration [rad/s²] at each sample, over a window of some samples.

    Raises:
        NoFitError: There is hardly any motion.
    """
    if motion.sampled.size < 500:
        raise NoFitError(f"only {motion.sampled.size} samples were recorded, wanted at least 500")
    period = float(np.median(np.diff(motion.sampled)))
    window = _window(motion)
    # On an even grid: losses and missed periods are bridged by a line.
    even = np.arange(motion.sampled[0], motion.sampled[-1], period)
    position = np.interp(even, motion.sampled, motion.position)
    smooth = [savgol_filter(position, window, 3, deriv=n, delta=period) for n in (1, 2)]
    speed, acceleration = (np.interp(motion.sampled, even, s) for s in smooth)
    return speed, acceleration


def _cuts(motion: Motion, speed: FloatArray, step: float) -> list[tuple[int, int]]:
    """Pieces from one moment of high speed to another; those in which little moves are left out."""
    begins: list[int] = []
    sampled, fast = motion.sampled, np.abs(speed)
    end = float(sampled[-1])
    at = float(sampled[0])
    while at < end:
        low, high = np.searchsorted(sampled, [at, at + 0.5 * PIECE_S])
        if high > low:
            begins.append(int(low + np.argmax(fast[low:high])))
        at += PIECE_S
    # What a stall has left unrecorded may have reached the servo at other times than it was sent.
    gaps = np.diff(sampled)
    stalls = np.flatnonzero(gaps > _STALL * np.median(gaps)) + 1
    edges = np.unique([*begins, *stalls.tolist(), sampled.size]).tolist()
    cuts = []
    for begin, after in itertools.pairwise(edges):
        moved = motion.position[begin:after]
        if after - begin >= 20 and np.ptp(moved) >= 8 * step:
            cuts.append((begin, after))
    if len(cuts) < 6:
        raise NoFitError(
            f"the shaft moved in {len(cuts) * PIECE_S:.1f} s only, wanted at least"
            f" {6 * PIECE_S:.1f} s"
        )
    return cuts


def torque_on(motion: Motion, delays: list[float]) -> list[FloatArray]:
    """The torque at each sample for each delay [s], smoothed as the motion is [N·m]."""
    grid = np.linspace(motion.sent[0], motion.sent[-1], 4 * motion.sent.size)
    held = motion.torque[np.searchsorted(motion.sent, grid, side="right") - 1]
    window = 2 * round(0.5 * _SMOOTH_S / float(grid[1] - grid[0])) + 1
    smooth = savgol_filter(held, window, 3)
    return [np.interp(motion.sampled - delay, grid, smooth) for delay in delays]


def _start(motion: Motion, speed: FloatArray, acceleration: FloatArray) -> Fit:
    """Where the fit begins: the torques, smoothed alike, against the motion, for each delay."""
    moving = np.abs(speed) > 0.15 * np.max(np.abs(speed))
    signs = np.sign(speed[moving])
    columns = np.column_stack([acceleration[moving], speed[moving], signs])
    best: tuple[float, float, FloatArray] | None = None
    delays = np.arange(0.0, _LATEST_S, 2.5e-4).tolist()
    for delay, acting in zip(delays, torque_on(motion, delays), strict=True):
        torque = acting[moving]
        found = np.linalg.lstsq(columns, torque, rcond=None)[0]
        left = float(np.sum((torque - columns @ found) ** 2))
        if best is None or left < best[0]:
            best = (left, delay, found)
    assert best is not None
    inertia, damping, coulomb = (float(value) for value in best[2])
    if inertia <= 0.0:
        raise NoFitError("the shaft does not speed up with the torque that was sent")
    empty = np.zeros((1, 1))
    nothing = Pieces(motion, empty, empty, empty > 0)
    # What cannot be told apart at the start begins near nothing, not below it.
    least = 0.05 * inertia
    return Fit(
        inertia, max(damping, least), max(coulomb, least), best[1], 0.0, (), 0.0, nothing, empty
    )


def _fitted(
    pieces: Pieces, start: Fit, speeds: FloatArray, *, with_play: bool
) -> tuple[Fit, FloatArray]:
    """The fit, and the speeds at the beginnings of the pieces."""
    model = _Model(pieces, with_play, start)
    values, speeds = _least_squares(model, speeds)
    linear = model.linear(values, speeds)
    left = linear.left[pieces.held]
    count = 5 if with_play else 4
    five = [*values[:count].tolist(), *([] if with_play else [0.0])]
    inertia, damping, coulomb, delay, play = five
    period = float(np.median(np.diff(pieces.motion.sampled)))
    errors = [*standard_errors(linear, period)[:count], *([] if with_play else [0.0])]
    loads = start.loads
    if loads is not None:
        static, *weights = values[count:].tolist()
        loads = replace(loads, static=static, weights=tuple(weights))
    fit = Fit(
        inertia,
        damping,
        coulomb,
        delay,
        play,
        stderr=tuple(
            float(np.hypot(error, share * value))
            for error, share, value in zip(errors, _SURE, five, strict=True)
        ),
        residual=float(np.sqrt(np.mean(left**2))),
        pieces=pieces,
        fitted=pieces.position + linear.left,
        loads=loads,
    )
    return fit, speeds


class _Model:
    """Residuals and their derivatives over the shared values and each piece's own speed."""

    def __init__(self, pieces: Pieces, with_play: bool, start: Fit) -> None:
        self.pieces = pieces
        self.count = 5 if with_play else 4
        self.begin = np.array([getattr(start, name) for name in NAMES[: self.count]])
        self.low = np.array([0.05 * start.inertia, 0.0, 0.0, -0.005, 0.0])[: self.count]
        self._weights = _weights(pieces)
        self._means = self._weights / self._weights.sum(axis=1, keepdims=True)
        inertia = start.inertia
        # Small beside what matters, large beside rounding.
        steps = [1e-5 * inertia, 1e-4 * inertia, 1e-4 * inertia, 1e-7, 1e-5]
        self._steps = np.array([*steps[: self.count], 1e-5])
        self._waves: FloatArray | None = None
        if start.loads is not None:
            more = np.array([start.loads.static, *start.loads.weights])
            self.begin = np.concatenate([self.begin, more])
            self.low = np.concatenate([self.low, [0.0], np.full(more.size - 1, -np.inf)])
            # Friction at rest decides where the shaft stays: only a larger step shows it.
            steps = [_STATIC_STEP * start.coulomb, *[1e-4 * inertia] * (more.size - 1)]
            self._steps = np.array([*self._steps[:-1], *steps, self._steps[-1]])
            between = 0.5 * (pieces.position[:, 1:] + pieces.position[:, :-1])
            self._waves = start.loads.waves(between)

    def linear(self, values: FloatArray, speeds: FloatArray) -> Linear:
        """All variants at once: as it is, and with each value a little larger."""
        count = values.size
        variants = np.tile(values, (count + 2, 1))
        variants[1 : count + 1] += np.diag(self._steps[:-1])
        starts = np.tile(speeds, (count + 2, 1))
        starts[-1] += self._steps[-1]
        shown = self._left(variants, starts)
        slopes = (shown[1:] - shown[0]) / self._steps[:, None, None]
        return Linear(shown[0], slopes[:-1], slopes[-1], self._weights)

    def costs(self, variants: FloatArray, speeds: FloatArray) -> FloatArray:
        """Weighted squares of each variant of the values, shape (v, values)."""
        shown = self._left(variants, np.tile(speeds, (variants.shape[0], 1)))
        squares: FloatArray = np.sum(self._weights * shown**2, axis=(1, 2))
        return squares

    def _left(self, variants: FloatArray, starts: FloatArray) -> FloatArray:
        """Fitted less measured for each variant of the values, shape (v, s, n)."""
        five = np.pad(variants[:, : self.count], ((0, 0), (0, 5 - self.count)))
        parameters = Parameters(*(five[:, n : n + 1] for n in range(5)))
        if self._waves is not None:
            static = variants[:, self.count : self.count + 1]
            load = np.tensordot(variants[:, self.count + 1 :], self._waves, axes=1)
            parameters = replace(parameters, static=static, load=load)
        shown = simulated(self.pieces, parameters, starts) - self.pieces.position
        shown -= np.sum(shown * self._means, axis=2, keepdims=True)
        return shown


def _weights(pieces: Pieces) -> FloatArray:
    """What a sample counts: one of a long run of equal ones says little that is new.

    The rounding of a shaft at rest is one error, however often it is read.
    """
    weights = pieces.held.astype(float)
    for position, weight, held in zip(pieces.position, weights, pieces.held, strict=True):
        changes = np.flatnonzero(np.diff(position[held])) + 1
        edges = np.concatenate([[0], changes, [int(held.sum())]])
        runs = np.diff(edges)
        weight[held] = np.repeat(np.minimum(1.0, _RUN / runs), runs)
    return weights


def _least_squares(model: _Model, speeds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values and speeds of the smallest weighted squares; Levenberg's damping, values bounded.

    A piece's own speed touches that piece alone, so it is eliminated piece by piece.
    """
    values, damped = model.begin, 1e-3
    now = model.linear(values, speeds)
    for _ in range(_ROUNDS):
        if now.cost < _EXACT**2 * now.left.size:
            break
        weighted = now.weights * now.left
        gradient = np.sum(now.shared * weighted, axis=(1, 2))
        free = (values > model.low) | (gradient < 0.0)
        rest = now.without_own()[free]
        normal = np.einsum("psn,qsn->pq", rest * now.weights, rest)
        right = np.sum(rest * weighted, axis=(1, 2))
        normal[np.diag_indices_from(normal)] *= 1.0 + damped
        step = np.zeros(values.shape)
        step[free] = -np.linalg.lstsq(normal, right, rcond=1e-12)[0]
        step = np.maximum(values + step, model.low) - values
        moved = now.left + np.tensordot(step, now.shared, axes=1)
        pull = np.sum(now.weights * now.own * moved, axis=1)
        after = speeds - pull / (now.own_square() * (1.0 + damped))
        tried = model.linear(values + step, after)
        gain = now.cost - tried.cost
        if gain > 0.0:
            values, speeds, now, damped = values + step, after, tried, 0.1 * damped
            if gain < _ENOUGH * now.cost:
                break
        elif damped > 1e3 or abs(gain) < _ENOUGH * now.cost:
            break
        else:
            damped *= 10.0
    return values, speeds
