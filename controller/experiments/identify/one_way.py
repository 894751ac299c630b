"""Fits stretches of motion in one direction, where every effect is linear in its size.

Between two turns friction has one sign, so the position is the double integral of torques of known
shape: a regression, whose only nonlinear values are the delay and the dead band. It needs no start
but a delay, and has one minimum; a simulation through the turns, which tells more, starts from it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.experiments.identify.effects import (
    ALWAYS,
    COGGING,
    FADING,
    NONE,
)
from haptic_wall.controller.experiments.identify.fitting import (
    NAMES,
    Fit,
    NoFitError,
    first_fit,
    moving,
    white_part,
)
from haptic_wall.controller.experiments.identify.motion import Motion, Pieces
from haptic_wall.controller.experiments.identify.output_error import NO_PRIOR, Prior
from haptic_wall.controller.experiments.identify.separable import Linear
from haptic_wall.controller.theory.checks import FloatArray

_SLOWEST = 0.15
"""Least speed [rad/s]: at less, its sign is not known"""
_TURN_S = 4e-3
"""Time near a turn that is left out [s]"""
_SHORTEST_S, _LONGEST_S = 0.025, 0.4
"""Length of a stretch [s]"""
_TRAVEL = 10.0
"""Least travel in a stretch [counts]"""
_STALL = 4.5
"""Periods without a sample that end a stretch"""
_ROUGH = ("gear", "dead_band", "sine", "cosine")
"""Effects without which an inertia can be far off"""
_ROUNDED = 1.05
"""Squares without noise that rounding explains, over those of rounding alone"""
_FADINGS = (0.1, 0.5, 2.0)
"""Tried speeds over which friction fades [rad/s]"""
_MOST_PERIODS = 200
"""Largest number of cogging periods in a turn"""
_SURE = 30.0
"""Least gain of an effect that is tried in many forms, over the variance of a sample"""
_ROUNDS, _ENOUGH = 8, 1e-4
_FEW = 8
"""Least number of stretches"""
_DIVERGES = "a fit of its friction does not converge"
_HUGE = 1e50
"""No motion is so large, nor changes so much with a value, in SI units"""
_FURTHEST = 3e-3
"""Largest correction of the delay in a round [s]"""


def fit_one_way(
    motion: Motion,
    step: float,
    priors: Mapping[str, Prior] | None = None,
    *,
    rough: bool = False,
) -> Fit:
    """Fit a servo with the effects that the motion shows; standard errors are not computed.

    Args:
        motion: A motion; the shaft moves for at least two seconds.
        step: One count of the encoder [rad]; 0: not quantised.
        priors: Prior knowledge of values, by name.
        rough: Do not search for the values that separate Coulomb from viscous friction.

    Raises:
        NoFitError: The motion is not sufficient.
    """
    regression = _Regression(motion, moving(motion), step, priors or {})
    start = first_fit(motion)
    values = {name: getattr(start, name) for name in NAMES[:4]}
    if rough:
        return regression.fit(regression.solved(values, _ROUGH))
    plain = regression.solved(values, [])
    best = regression.solved(plain.values, [name for group in ALWAYS for name in group])
    sure = _SURE / regression.count
    noise = max(regression.white_part(plain), step / math.sqrt(12.0))
    rounded = plain.cost / regression.count - noise**2 < (_ROUNDED - 1.0) * step**2 / 12.0
    if plain.cost - best.cost <= sure * best.cost and rounded:
        return regression.fit(plain)
    searches = [(FADING, _fadings), (COGGING, regression.coggings)]
    for group, tried in searches:
        found: list[_Solved] = []
        for each in tried(best):
            with suppress(NoFitError):  # of so many starts one may diverge
                solved = regression.solved(each, [*best.names, *group[:-1]])
                found.append(solved)
        if not found:
            continue
        better = min(found, key=lambda each: each.cost)
        needed = group == FADING and best.values["damping"] < abs(best.values["uneven"])
        if needed or best.cost - better.cost > sure * better.cost:
            best = better
    if {"cogging_sine", "excess"} <= {*best.names}:  # the excess may have stood for the cogging
        best = regression.without("excess", best, sure)
    return regression.fit(best if plain.cost - best.cost > sure * best.cost else plain)


class _Solved:
    """Values with the names of the effects among them, and the squares that they leave."""

    def __init__(
        self,
        values: dict[str, float],
        names: Sequence[str],
        left: FloatArray,
        speeds: FloatArray,
        away: float,
    ) -> None:
        self.values = values
        self.names = list(names)
        self.left = left
        self.speeds = speeds
        self.cost = float(np.sum(left**2)) + away


def _fadings(best: _Solved) -> Iterator[dict[str, float]]:
    return ({**best.values, "fading": fading} for fading in _FADINGS)


class _Regression:
    """The stretches of a motion, and integrals over them.

    Arrays have the shape (s, n): stretches and samples, short ones padded.
    """

    def __init__(
        self, motion: Motion, speed: FloatArray, step: float, priors: Mapping[str, Prior]
    ) -> None:
        self._motion = motion
        self._priors = priors
        self._noise = max(step / math.sqrt(12.0), 1e-6)
        self._speed = speed.copy()
        stretches = list(_stretches(motion, speed, max(step, 1e-5)))
        if len(stretches) < _FEW:
            raise NoFitError(f"the shaft moved {len(stretches)} times only, wanted at least {_FEW}")
        longest = max(end - begin for begin, end in stretches)
        count = np.arange(longest)
        self._index = np.array([np.minimum(b + count, e - 1) for b, e in stretches])
        self._held = np.array([count < e - b for b, e in stretches])
        self._sign = np.sign(speed[self._index[:, :1]])
        self._position = motion.position[self._index]
        sampled = motion.sampled[self._index]
        weight = self._held.astype(float)
        self.count = int(weight.sum())
        mean = (sampled * weight).sum(axis=1) / weight.sum(axis=1)
        own = np.stack([weight, (sampled - mean[:, None]) * weight])
        nothing = np.zeros((0, *weight.shape))
        self._stretches = Linear(-self._position, nothing, own, weight, np.zeros(0))
        self._sampled = sampled
        self._delay = math.nan
        self._middle = float(np.median(motion.position))

    def _set_delay(self, delay: float) -> None:
        """Lay the grid of all instants at which a torque changes or a sample is taken."""
        motion = self._motion
        acts = motion.sent + delay
        inside = acts[(acts > motion.sampled[0]) & (acts < motion.sampled[-1])]
        grid = np.concatenate([motion.sampled, inside])
        order = np.argsort(grid, kind="stable")
        where = np.empty(grid.size, dtype=np.intp)
        where[order] = np.arange(grid.size)
        self._at = where[: motion.sampled.size][self._index]
        grid = grid[order]
        self._lengths = np.diff(grid)
        middle = 0.5 * (grid[1:] + grid[:-1])
        torque = np.concatenate([[0.0], motion.torque])
        self._torque = torque[np.searchsorted(acts, middle, side="right")]
        self._angle = np.interp(middle, motion.sampled, motion.position)
        self._between = middle
        self._delay = delay

    def _integrals(self, force: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the integral of a force on the grid, and the integral of that, at the samples."""
        lengths = self._lengths
        once = np.concatenate([[0.0], np.cumsum(force * lengths)])
        twice = np.cumsum(once[:-1] * lengths + 0.5 * force * lengths**2)
        return once[self._at], np.concatenate([[0.0], twice])[self._at]

    def _forces(self, values: Mapping[str, float], names: Sequence[str]) -> dict[str, FloatArray]:
        """Return the torque that acts, and what a unit of each value adds to it."""
        speed = np.interp(self._between, self._motion.sampled, self._speed)
        sign, fast = np.sign(speed), np.abs(speed)
        missing = values.get("dead_band", 0.0)
        torque = self._torque - np.clip(self._torque, -missing, missing)
        angle = self._angle
        sine, cosine = np.sin(angle), np.cos(angle)
        weight = values.get("sine", 0.0) * sine + values.get("cosine", 0.0) * cosine
        forces = {
            "inertia": torque,
            "damping": -speed,
            "coulomb": -sign,
            "gear": -np.abs(torque + weight) * sign,
            "uneven": -fast,
            "drag": -speed * fast,
            "dead_band": -np.where(np.abs(self._torque) > missing, np.sign(self._torque), 0.0),
            "sine": -sine,
            "cosine": -cosine,
        }
        if "excess" in names:
            forces["excess"] = -sign * np.exp(-fast / values["fading"])
        if "cogging_sine" in names:
            turned = values["periods"] * (angle - self._middle)
            forces["cogging_sine"] = -np.sin(turned)
            forces["cogging_cosine"] = -np.cos(turned)
        return {name: forces[name] for name in ("inertia", "damping", "coulomb", *names)}

    @np.errstate(over="ignore", invalid="ignore")  # of values that grow without bound
    def solved(self, start: Mapping[str, float], names: Sequence[str]) -> _Solved:
        """Return the values with the least squares, from these on.

        Raises:
            NoFitError: They grow without bound; the speeds are as before.
        """
        speed = self._speed.copy()
        try:
            return self._descended(start, names)
        except NoFitError:
            self._speed = speed
            raise

    def without(self, name: str, found: _Solved, sure: float) -> _Solved:
        """Return values without an effect that explains no more than ``sure`` of the squares.

        It stays where no viscous friction would be left.
        """
        try:
            fewer = self.solved(found.values, [each for each in found.names if each != name])
        except NoFitError:
            return found
        brakes = fewer.values["damping"] > abs(fewer.values["uneven"])
        return fewer if brakes and fewer.cost - found.cost <= sure * found.cost else found

    def _descended(self, start: Mapping[str, float], names: Sequence[str]) -> _Solved:
        values = {**dict.fromkeys(names, 0.0), **start}
        before = math.inf
        for _ in range(_ROUNDS):
            self._set_delay(values["delay"])
            forces = self._forces(values, names)
            once, twice = map(
                np.array, zip(*(self._integrals(each) for each in forces.values()), strict=True)
            )
            fitted = [name for name in forces if name != "inertia"]
            inertia = values["inertia"]
            # The dead band is in the torque already.
            sizes = [1.0, *(0.0 if n == "dead_band" else values[n] for n in fitted)]
            moved = np.tensordot(sizes, twice, axes=1) / inertia
            shared = np.concatenate(
                [-moved[None] / inertia, twice[1:] / inertia, -once[:1] / inertia]
            )
            every = ["inertia", *fitted, "delay"]
            precision, away = self._known(every, values)
            if not (np.abs(shared).max() < _HUGE and np.abs(away).max() < _HUGE):
                raise NoFitError(_DIVERGES)
            linear = replace(
                self._stretches,
                left=moved - self._position,
                shared=shared,
                precision=precision,
            )
            step = linear.step(away)
            step[0] = min(max(step[0], -0.4 * inertia), 0.5 * inertia)
            step[-1] = min(max(step[-1], -_FURTHEST), _FURTHEST)
            for name, change in zip(every, step.tolist(), strict=True):
                values[name] += change
            values["dead_band"] = max(values.get("dead_band", 0.0), 0.0)
            slopes = -linear.own_part(linear.left[None])[0, 1]
            reached = linear.left + np.tensordot(step, shared, axes=1)
            left = self._held * -linear.without_own(reached[None])[0]
            speed = slopes[:, None] + np.tensordot(sizes, once, axes=1) / inertia
            right = self._held & (speed * self._sign > 0.0)
            self._speed[self._index[right]] = speed[right]
            cost = float(np.sum(left**2))
            if abs(before - cost) < _ENOUGH * cost:
                break
            before = cost
        # Without any force each stretch would pass at a speed of its own.
        alone = self._stretches.without_own(self._position[None])[0]
        if not cost <= float(np.sum(self._held * alone**2)):
            raise NoFitError(_DIVERGES)
        precision, away = self._known(every, values)
        return _Solved(values, names, left, np.array(speed[:, 0]), float(precision @ away**2))

    def _known(
        self, names: Sequence[str], values: Mapping[str, float]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the weight of the prior of each value, and how far it is from its mean."""
        priors = [self._priors.get(name, NO_PRIOR) for name in names]
        precision = np.array([prior.precision(self._noise) for prior in priors])
        return precision, np.array(
            [values[n] - prior.mean for n, prior in zip(names, priors, strict=True)]
        )

    def coggings(self, found: _Solved) -> Iterator[dict[str, float]]:
        """Yield the values with the cogging that explains most of what is left."""
        values = found.values
        self._set_delay(values["delay"])
        forces = self._forces(values, found.names)
        base = np.array([self._integrals(each)[1] for each in forces.values()])
        without_own = self._stretches.without_own
        own = np.linalg.qr(without_own(base)[:, self._held].T)[0]
        left = found.left[self._held]
        away = self._angle - self._middle
        most, best = -1.0, 2.0
        for periods in range(2, _MOST_PERIODS + 1, 3):
            waves = np.array(
                [self._integrals(wave(periods * away))[1] for wave in (np.sin, np.cos)]
            )
            pair = without_own(waves)[:, self._held]
            pair = pair - (pair @ own) @ own.T
            target = pair @ left
            normal = pair @ pair.T
            explained = float(target @ np.linalg.lstsq(normal, target, rcond=1e-9)[0])
            if explained > most:
                most, best = explained, float(periods)
        yield {**values, "periods": best}

    def white_part(self, found: _Solved) -> float:
        """Return the root mean square of what is left that changes at each sample [rad]."""
        return white_part(found.left, self._held)

    def fit(self, found: _Solved) -> Fit:
        """Return the values as a fit of the stretches."""
        values = found.values
        names = [*found.names]
        groups = (FADING, COGGING)
        names += dict.fromkeys(group[-1] for group in groups if group[0] in names)
        sizes: dict[str, Any] = {name: values[name] for name in names}
        effects = replace(NONE, center=self._middle, fitted=tuple(names), **sizes)
        pieces = Pieces(self._motion, self._sampled, self._position, self._held)
        damping = max(values["damping"], 0.0)
        return Fit(
            max(values["inertia"], 0.0),
            damping,
            max(values["coulomb"], 0.0),
            values["delay"],
            0.0,
            stderr=(0.0,) * 5,
            residual=math.sqrt(found.cost / self.count),
            pieces=pieces,
            fitted=self._position - found.left,
            speeds=found.speeds,
            effects=effects,
            weaker=(max(damping - abs(effects.uneven), 0.0), 0.0),
        )


def _stretches(motion: Motion, speed: FloatArray, step: float) -> Iterator[tuple[int, int]]:
    """Yield the first sample of each stretch in one direction, and the one after its last."""
    gaps = np.diff(motion.sampled)
    period = float(np.median(gaps))
    way = np.where(np.abs(speed) > _SLOWEST, np.sign(speed), 0.0)
    changed: NDArray[np.bool_] = np.concatenate(
        [[True], (way[1:] != way[:-1]) | (gaps > _STALL * period)]
    )
    edges = [*np.flatnonzero(changed).tolist(), way.size]
    turn = round(_TURN_S / period)
    for begin, after in itertools.pairwise(edges):
        first, last = begin + turn, after - turn
        if way[begin] == 0.0 or (last - first) * period < _SHORTEST_S:
            continue
        if abs(motion.position[last - 1] - motion.position[first]) < _TRAVEL * step:
            continue
        parts = max(1, round((last - first) * period / _LONGEST_S))
        cuts = np.linspace(first, last, parts + 1).astype(int).tolist()
        yield from itertools.pairwise(cuts)
