"""Finds a servo's vibration mode in its cruises: frequency and damping ratio with bounds.

Everything that fits nearly as well as the best fit is inside the bounds. Where a rigid shaft does,
no mode was seen, and the result is the frequency below which there is none.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from haptic_wall.controller.experiments.identify.mode_fit import (
    FEWEST,
    HIGHEST_HZ,
    LAGS_S,
    LOWEST_HZ,
    PER_OCTAVE,
    RATIOS,
    Cruises,
    ModeModel,
)
from haptic_wall.controller.theory.checks import FloatArray

WORSE, BEYOND = 1.05, 1.02
"""Squares of what cannot be true, over the least: that there is no mode, or one; and that a mode
that was seen has other values"""
SEEN_HZ = 220.0
"""Above it a mode cannot be told from a lag of the current loop"""
MOST_RATIO = 0.3
"""Largest damping ratio that is looked for"""
LEAST_LOAD = 0.2
"""Load over motor inertia from which a mode is seen by an encoder on the motor"""
_CLEARLY = 1.3
"""Squares over the limit from which a lag of the current loop need not be tried"""
_FLOORS = (0.01, 0.1)
"""Least relative distance of the bounds of frequency and damping ratio"""
_GAINS = (0.4, 2.5)
"""Of a vibration at the output, fitted freely, over that of two masses"""
_STARTS = 3
_FEWEST_CRUISES = 4
_IMPOSSIBLE = 1e6
"""Stands for infinite squares, over those of a rigid shaft"""
_NARROWEST, _WIDEST = (0.004, 0.05), (0.7, 5.0)
"""First and last distance of a bound that is tried, in the logarithm of each value"""


@dataclass(frozen=True, slots=True)
class Mode:
    """A vibration mode, or the frequency below which there is none."""

    hertz: float | None
    """With both ends free; None: not seen"""
    low_hz: float
    """Least possible frequency; not seen: below it there is none"""
    high_hz: float
    ratio: float
    """Damping ratio; not seen: 0, and no bounds"""
    low_ratio: float
    high_ratio: float
    inertia: float
    """Inertia of motor and load, in commanded units [kg·m²]"""
    load_ratio: float | None
    """Load over motor inertia, where the encoder is on the motor and has seen it"""
    lag: float
    """Time constant that the current loop may have [s]"""
    residual: float
    """Root mean square of measured less fitted position [rad]"""


@dataclass(frozen=True, slots=True)
class _Point:
    cost: float
    hertz: float
    ratio: float
    lag: float


def looked_at(model: ModeModel) -> Mode:
    """Return the mode that cruises over all frequencies show."""
    rigid = min(model.solved(None, lag=lag).cost for lag in LAGS_S)
    count = round(PER_OCTAVE * math.log2(HIGHEST_HZ / LOWEST_HZ)) + 1
    grid = np.geomspace(LOWEST_HZ, HIGHEST_HZ, count).tolist()
    rows = [[_Point(model.solved(f, z).cost, f, z, 0.0) for z in RATIOS] for f in grid]
    points = [min(row, key=_cost) for row in rows]
    starts = sorted(_valleys(points), key=_cost)[:_STARTS]
    best = min((_refined(model, start) for start in starts), key=_cost)
    best = _with_lag(model, best)
    least = min(best.cost, rigid)
    seen = rigid > WORSE * least and LOWEST_HZ <= best.hertz < SEEN_HZ
    if seen and _is_like(model, best):
        return _seen(model, best)
    least = rigid  # what fits better is no vibration
    solved = model.solved(None)
    return Mode(
        None,
        min(_lowest(model, points, WORSE * least), SEEN_HZ),
        HIGHEST_HZ,
        *(0.0, 0.0, 0.0),
        1.0 / float(solved.gains[0]),
        None,
        0.0,
        math.sqrt(solved.cost / model.samples),
    )


def closer(model: ModeModel, mode: Mode) -> Mode:
    """Return a mode that was seen, by other cruises."""
    assert mode.hertz is not None
    start = _Point(math.inf, mode.hertz, mode.ratio, mode.lag)
    return _seen(model, _with_lag(model, _refined(model, start)))


def one_way(model: ModeModel, mode: Mode, load_ratio: float, least: float) -> Cruises:
    """Return the cruises, each with its longest part in which the motor keeps its direction.

    Args:
        model: Model of the cruises.
        mode: One that was seen.
        load_ratio: Largest possible load over motor inertia.
        least: Slowest speed in the cruise's direction [rad/s].
    """
    assert mode.hertz is not None
    cruises = model.cruises
    motor = model.motor_speed(mode.hertz, mode.ratio, mode.lag, load_ratio)
    ahead = (motor * cruises.way[:, None] > least) & (cruises.weights > 0.0)
    kept = np.zeros_like(cruises.weights)
    for row, line in zip(kept, ahead, strict=True):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(int), [0]])))
        runs = edges.reshape(-1, 2)
        if runs.size:
            first, last = runs[np.argmax(runs[:, 1] - runs[:, 0])]
            row[first:last] = float(last - first >= FEWEST)
    used = np.any(kept > 0.0, axis=1)
    if np.count_nonzero(used) < _FEWEST_CRUISES:
        return cruises
    weights = (cruises.weights * kept)[used]
    return replace(
        cruises,
        weights=weights,
        position=cruises.position[used],
        torque=cruises.torque[used],
        way=cruises.way[used],
    )


def _cost(point: _Point) -> float:
    return point.cost


def _valleys(points: list[_Point]) -> Iterator[_Point]:
    """Yield the points that are lower than their neighbours."""
    for n, point in enumerate(points):
        beside = [*points[max(n - 1, 0) : n], *points[n + 1 : n + 2]]
        if all(point.cost <= other.cost for other in beside):
            yield point


def _lowest(model: ModeModel, points: list[_Point], limit: float) -> float:
    """Return the lowest frequency at which there may be a mode [Hz]."""
    gain = LEAST_LOAD if model.on_motor else None
    for point in points:
        if point.cost > _CLEARLY * limit:
            continue
        tried = (
            model.solved(point.hertz, z, lag, gain).cost
            for z in (RATIOS[0], RATIOS[1], MOST_RATIO)
            for lag in LAGS_S
        )
        if any(cost <= limit for cost in tried):
            return point.hertz
    return HIGHEST_HZ


def _with_lag(model: ModeModel, best: _Point) -> _Point:
    """Return the best fit with any lag of the current loop."""
    others = [_refined(model, replace(best, lag=lag)) for lag in LAGS_S if lag != best.lag]
    return min((best, *others), key=_cost)


def _is_like(model: ModeModel, point: _Point) -> bool:
    """Return whether the vibration has the gain of two masses when it is fitted freely."""
    gains = model.solved(point.hertz, point.ratio, point.lag, free=True).gains
    share = float(gains[1] / gains[0])
    return share > 0.0 if model.on_motor else _GAINS[0] < -share < _GAINS[1]


def _load_of(model: ModeModel, point: _Point) -> float:
    """Return load over motor inertia as an encoder on the motor has seen it."""
    gains = model.solved(point.hertz, point.ratio, point.lag).gains
    return float(gains[1] / gains[0])


def _seen(model: ModeModel, best: _Point) -> Mode:
    ends = [_ends(model, best, which) for which in (0, 1)]
    (low_hz, high_hz), (low_ratio, high_ratio) = (
        (min(low, value * (1.0 - floor)), max(high, value * (1.0 + floor)))
        for (low, high), value, floor in zip(ends, (best.hertz, best.ratio), _FLOORS, strict=True)
    )
    return Mode(
        best.hertz,
        low_hz,
        high_hz,
        best.ratio,
        low_ratio,
        high_ratio,
        1.0 / float(model.solved(best.hertz, best.ratio, best.lag).gains[0]),
        _load_of(model, best) if model.on_motor else None,
        best.lag,
        math.sqrt(best.cost / model.samples),
    )


def _refined(model: ModeModel, start: _Point) -> _Point:
    """Return the nearest best fit with the start's lag."""
    from scipy.optimize import minimize

    scale = model.solved(None).cost

    def cost(point: FloatArray) -> float:
        return min(model.solved(*_values(point), start.lag).cost / scale, _IMPOSSIBLE)

    begun = np.log([start.hertz, start.ratio])
    simplex = begun + np.array([[0.0, 0.0], [0.02, 0.0], [0.0, 0.5]])
    options = {"initial_simplex": simplex, "xatol": 3e-4, "fatol": 1e-6, "maxfev": 80}
    found = minimize(cost, begun, method="Nelder-Mead", options=options)
    return _Point(float(found.fun) * scale, *_values(found.x), start.lag)


def _values(point: FloatArray) -> tuple[float, float]:
    hertz = float(np.clip(np.exp(point[0]), 0.8 * LOWEST_HZ, 1.2 * HIGHEST_HZ))
    return hertz, float(np.clip(np.exp(point[1]), 1e-4, MOST_RATIO))


def _ends(model: ModeModel, best: _Point, which: int) -> tuple[float, float]:
    """Return between which values of one quantity some value of the other fits nearly as well."""
    from scipy.optimize import minimize_scalar

    at = np.log([best.hertz, best.ratio])
    limit = BEYOND * best.cost

    def fits(away: float) -> bool:
        def cost(other: float) -> float:
            point = at.copy()
            point[which] += away
            point[1 - which] += other
            return model.solved(*_values(point), best.lag).cost

        if cost(0.0) < limit:
            return True
        reach = 1.2 if which == 0 else 0.03
        options = {"xatol": 0.01 * reach, "maxiter": 8}
        found = minimize_scalar(cost, bounds=(-reach, reach), method="bounded", options=options)
        return float(found.fun) < limit

    ends = []
    for sign in (-1.0, 1.0):
        low, high = 0.0, _NARROWEST[which]
        while high < _WIDEST[which] and fits(sign * high):
            low, high = high, 2.0 * high
        for _ in range(3):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if fits(sign * middle) else (low, middle)
        ends.append(float(np.exp(at[which] + sign * high)))
    return ends[0], min(ends[1], MOST_RATIO if which else 1.2 * HIGHEST_HZ)
