"""Finds the critical stiffness by simulation: above it the motion after a kick grows.

Growth means the amplitude of a two-sided wall's oscillation (``turning``), or the speed that one
contact with a one-sided wall returns (``bounce``). The search treats all walls at once: it tries
several stiffnesses of each in parallel, and repeats between the stiffest that does not grow and the
softest that does, until they are close enough.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptic_wall.controller.experiments.maps.bounce import returned
from haptic_wall.controller.experiments.maps.limits import first_guess
from haptic_wall.controller.experiments.maps.turning import growth
from haptic_wall.controller.experiments.maps.walls import Walls, split_delay
from haptic_wall.controller.theory.checks import (
    FloatArray,
    broadcast,
    not_negative,
    number,
    positive,
    samples,
)

_FIRST = np.geomspace(0.55, 2.1, 10)
_REACH = 4.0
"""Factor between searched ranges while no limit is found."""
_SPREAD = 5
"""Number of stiffnesses tried between two known ones, beside two at the interpolated limit."""
_SOFTEST, _STIFFEST = 1e-4, 20.0
"""Ends of the search in units of m/T²: an oscillation of 600 samples, and more than any wall
without friction can have."""
_CYCLES_COARSE, _CYCLES = 8.0, 20.0
_COARSE = 1.05
"""Ratio of neighbouring stiffnesses below which the growth is fitted precisely."""


def simulated_critical_stiffness(
    inertia: ArrayLike,
    damping: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    *,
    coulomb: ArrayLike = 0.0,
    position_step: ArrayLike = 0.0,
    backlash: ArrayLike = 0.0,
    torque_limit: ArrayLike = np.inf,
    one_sided: bool = False,
    velocity_samples: ArrayLike = 1,
    kick: ArrayLike = 0.01,
    tolerance: float = 1e-4,
) -> FloatArray:
    """Return the stiffness above which the simulated motion after a kick grows.

    Two-sided: the servo is let go at rest, ``kick`` from the wall, where it was held for long: it
    starts at a turning point with v = 0 and the velocity estimate sees no jump; the amplitude of
    the oscillation grows. One-sided: the servo comes freely with the speed that the spring alone
    would stop after ``kick``; that speed grows from entry to exit.

    Without friction, quantisation, backlash and limit the kick does not matter. With them the
    result is a property of the kick too.

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous friction b >= 0 [N·m·s/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        coulomb: Coulomb friction c >= 0 [N·m].
        position_step: Encoder count q >= 0 [rad]; 0: not quantised. The wall stands on a count.
        backlash: Between shaft and encoder, full width, >= 0 [rad].
        torque_limit: [N·m], > 0; inf: none.
        one_sided: The wall never pulls.
        velocity_samples: N of the velocity difference, >= 1.
        kick: > 0 [rad].
        tolerance: Wanted relative accuracy, > 0.

    Returns:
        Stiffness [N·m/rad] in the broadcast shape: the middle between two neighbouring ones, of
        which one grows. 0 where the motion grows at the softest wall tried (1e-4 m/T², and below
        half the limit without friction), inf where it does not at the stiffest (20 m/T²).

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    arrays = broadcast(
        inertia=positive("inertia", inertia),
        damping=not_negative("damping", damping),
        virtual_damping=number("virtual_damping", virtual_damping),
        period=positive("period", period),
        delay=not_negative("delay", delay),
        coulomb=not_negative("coulomb", coulomb),
        position_step=not_negative("position_step", position_step),
        backlash=not_negative("backlash", backlash),
        torque_limit=_limit(torque_limit),
        velocity_samples=samples("velocity_samples", velocity_samples),
        kick=positive("kick", kick),
    )
    m, b, big_b, t, t_d, c, q, slack, limit, n, amplitude = (a.ravel() for a in arrays)
    whole, lag, rest = split_delay(t_d, t)
    walls = Walls(
        inertia=m,
        damping=b,
        coulomb=c,
        counts_per_radian=np.where(q > 0.0, 1.0 / np.where(q > 0.0, q, 1.0), 0.0),
        backlash=slack,
        torque_limit=limit,
        torque_step=np.zeros_like(m),
        stiffness=np.zeros_like(m),
        virtual_damping=big_b,
        period=t,
        whole=whole,
        lag=lag,
        rest=rest,
        velocity_samples=n.astype(np.int64),
        one_sided=np.full(m.size, one_sided),
    )
    found = onset(walls, amplitude, float(positive("tolerance", tolerance)))
    result: FloatArray = found.reshape(arrays[0].shape)[()]
    return result


def onset(walls: Walls, kick: FloatArray, tolerance: float) -> FloatArray:
    """Return ``simulated_critical_stiffness`` of the given walls; their own stiffness is not used.

    Args:
        walls: One- and two-sided ones may be mixed.
        kick: Shape (n,), > 0 [rad].
        tolerance: Wanted relative accuracy.
    """
    unit = walls.moved / walls.period**2
    softest, stiffest = _SOFTEST * unit, _STIFFEST * unit
    start = first_guess(walls)
    softest = np.where(start > 0.0, np.minimum(softest, 0.5 * start), softest)
    bracket = _Brackets(np.zeros_like(start), np.full_like(start, np.inf))
    ladder = np.maximum(start, softest)[:, None] * _FIRST
    every = np.arange(walls.size)
    _try(walls, kick, bracket, every, ladder)
    while (open_ := _unbounded(bracket, softest, stiffest)).size:
        low, high = bracket.low[open_], bracket.high[open_]
        up = np.isinf(high)
        share = np.linspace(0.0, 1.0, _SPREAD + 1)[1:]
        edge = np.where(up, low, high)[:, None]
        ladder = np.where(up[:, None], edge * _REACH**share, edge / _REACH ** share[::-1])
        _try(walls, kick, bracket, open_, ladder)
    bounded = (bracket.low > 0.0) & np.isfinite(bracket.high)
    while (wide := every[bounded & (bracket.ratio > 1.0 + tolerance)]).size:
        _try(walls, kick, bracket, wide, bracket.between(wide, tolerance))
    return np.where(bounded, bracket.middle, np.where(bracket.low > 0.0, np.inf, 0.0))


class _Brackets:
    """For each wall the stiffest that does not grow, and the softest above it that does."""

    def __init__(self, low: FloatArray, high: FloatArray) -> None:
        self.low, self.high = low, high
        self.low_growth, self.high_growth = np.full_like(low, -1.0), np.full_like(high, 1.0)

    @property
    def ratio(self) -> FloatArray:
        """Return the ratio of the two."""
        with np.errstate(divide="ignore"):
            return self.high / self.low

    @property
    def middle(self) -> FloatArray:
        """Return the stiffness with zero interpolated growth."""
        share = -self.low_growth / (self.high_growth - self.low_growth)
        high = np.where(np.isfinite(self.high), self.high, 0.0)
        return self.low + share * (high - self.low)

    def between(self, who: NDArray[np.intp], tolerance: float) -> FloatArray:
        """Return the next stiffnesses to try, in the bracket and near the interpolated one."""
        low, ratio = self.low[who, None], self.ratio[who, None]
        spread = low * ratio ** (np.arange(1, _SPREAD + 1) / (_SPREAD + 1))
        middle = self.middle[who, None]
        near = np.clip(
            middle * np.array([1.0 - 0.45 * tolerance, 1.0 + 0.45 * tolerance]), low, low * ratio
        )
        return np.sort(np.concatenate([spread, near], axis=1), axis=1)

    def narrow(self, who: NDArray[np.intp], ladder: FloatArray, growths: FloatArray) -> None:
        """Narrow the brackets by rising stiffnesses and their growths."""
        grows = growths > 0.0
        lanes = ladder.shape[1]
        first = np.where(grows.any(axis=1), np.argmax(grows, axis=1), lanes)
        rows = np.arange(who.size)
        some = first < lanes
        softest = np.minimum(first, lanes - 1)
        self.high[who[some]] = ladder[rows, softest][some]
        self.high_growth[who[some]] = growths[rows, softest][some]
        some = first > 0
        stiffest = np.maximum(first - 1, 0)
        self.low[who[some]] = ladder[rows, stiffest][some]
        self.low_growth[who[some]] = np.minimum(growths[rows, stiffest][some], 0.0)


def _unbounded(bracket: _Brackets, softest: FloatArray, stiffest: FloatArray) -> NDArray[np.intp]:
    """Return walls whose limit may lie beyond the tried range, up to the end of the search."""
    below = (bracket.low == 0.0) & (bracket.high > softest)
    above = np.isinf(bracket.high) & (bracket.low < stiffest)
    return np.flatnonzero(below | above)


def _try(
    walls: Walls,
    kick: FloatArray,
    bracket: _Brackets,
    who: NDArray[np.intp],
    ladder: FloatArray,
) -> None:
    """Simulate ascending stiffnesses (walls × stiffnesses), and narrow the brackets."""
    lanes = ladder.shape[1]
    many = walls.take(who).with_stiffness(ladder)
    kicks = np.repeat(kick[who], lanes)
    growths = np.empty(many.size)
    contact = np.flatnonzero(many.one_sided)
    swing = np.flatnonzero(~many.one_sided)
    if contact.size:
        growths[contact] = returned(many.take(contact), kicks[contact])
    if swing.size:
        coarse = float(np.max(ladder[:, 1] / ladder[:, 0])) > _COARSE
        cycles = _CYCLES_COARSE if coarse else _CYCLES
        growths[swing] = growth(many.take(swing), kicks[swing], cycles)
    bracket.narrow(who, ladder, growths.reshape(ladder.shape))


def _limit(value: ArrayLike) -> FloatArray:
    limit = np.asarray(value, dtype=np.float64)
    if not np.all(limit > 0.0):
        raise ValueError(f"torque_limit must be > 0, got {float(np.min(limit)):g}")
    return limit
