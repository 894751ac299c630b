"""Finds a servo's vibration mode in its cruises: frequency and damping ratio with bounds.

The servo cruises while its torque sweeps all frequencies. Everything that fits nearly as well as
the best fit is inside the bounds. Where a rigid shaft does, no mode was seen, and the result is the
frequency below which there is none.

The encoder, on the output, does not see the ratio of the two masses: to both together the motion is
the same whatever the load's share. Bounds of that ratio come from what was believed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.experiments.identify.bench import Bench
from haptic_wall.controller.experiments.identify.cruise import cruises
from haptic_wall.controller.experiments.identify.excitation import Bounds
from haptic_wall.controller.experiments.identify.fit import Fit
from haptic_wall.controller.experiments.identify.mode_fit import (
    FEWEST,
    LAGS_S,
    ModeModel,
    cruises_of,
)
from haptic_wall.controller.experiments.identify.motion import motion_of
from haptic_wall.controller.guard.belief import Bounded

_WORSE, _BEYOND = 1.05, 1.02
"""Squares of what cannot be true, over the least: that there is no mode, or one; and that a mode
that was seen has other values"""
LOWEST_HZ, HIGHEST_HZ = 5.0, 400.0
"""Frequencies between which a mode is looked for"""
_SEEN_HZ = 220.0
"""Above it a mode cannot be told from a lag of the current loop"""
_PER_OCTAVE, _RATIOS = 12, (0.01, 0.04, 0.15, 0.3)
"""Frequencies and damping ratios at which a mode is looked for; the last is the largest"""
_FLOORS = (0.01, 0.25)
"""Least relative distance of the bounds of frequency and damping ratio: where friction turns with
the motor, a simulated ratio was found 17 % too large"""
_CLEARLY = 1.4
"""Squares over those of a rigid shaft from which a lag of the current loop need not be tried"""
_GAINS = (0.4, 2.5)
"""Of a vibration at the output, fitted freely, over that of two masses"""
_BOX, _CLOSER, _ROUNDS = (0.06, 0.7), 0.4, 5
"""Half the size of the grid about the best point so far, in the logarithm of frequency and ratio;
its factor from one round to the next; number of rounds"""
_FIRST, _WIDEST, _OTHER = (0.004, 0.05), (0.7, 5.0), (0.03, 1.2)
"""Distances in those logarithms: the first and the last bound that are tried, and how far a value
gives way when the other one is bounded"""
FEWEST_CRUISES = 6
"""Least number that tells something"""


@dataclass(frozen=True, slots=True)
class Mode:
    """A vibration mode, or the frequency below which there is none."""

    hertz: Bounded
    """With both ends free [Hz]; not seen: below the lower bound there is none"""
    ratio: Bounded | None
    """Damping ratio; None: not seen"""
    inertia: float
    """Inertia of motor and load, in commanded units [kg·m²]"""


class _Point(NamedTuple):
    cost: float
    hertz: float
    ratio: float
    lag: float


def find_mode(bench: Bench, fit: Fit, bounds: Bounds, amplitude: float) -> Mode | None:
    """Move a fitted servo, and return its vibration mode, or the absence of one.

    Args:
        bench: The servo.
        fit: Fit of its other motions.
        bounds: Limits of the motions.
        amplitude: Wanted excursion to each side [rad].

    Returns:
        None: the cruises were too short to tell anything.
    """
    phases = cruises(fit, bench.corrected(fit), bounds, amplitude)
    played = bench.play("mode", phases)
    rows = played.rows[played.rows["sampled_ns"] > 0]
    spans = []
    for number, phase in enumerate(phases):
        sampled = (rows["sampled_ns"][rows["phase"] == number] - rows["sampled_ns"][0]) * 1e-9
        if phase.wave == "sine" and sampled.size > FEWEST:
            spans.append((float(sampled[0]), float(sampled[-1]), -float(np.sign(phase.center))))
    found = cruises_of(motion_of(played.rows), spans, bounds.period, fit)
    if len(found.weights) < FEWEST_CRUISES:
        return None
    return mode_of(ModeModel(found, fit["inertia"]))


def mode_of(model: ModeModel) -> Mode:
    """Return the mode that cruises over all frequencies show."""
    rigid = min(model.solved(None, lag=lag).cost for lag in LAGS_S)
    octaves = math.log2(HIGHEST_HZ / LOWEST_HZ)
    grid = np.geomspace(LOWEST_HZ, HIGHEST_HZ, round(_PER_OCTAVE * octaves) + 1).tolist()
    coarse = {hertz: min(_points(model, [hertz], _RATIOS, (0.0,))) for hertz in grid}
    best = min(coarse.values())
    for round_ in range(_ROUNDS):
        away = [width * _CLOSER**round_ for width in _BOX]
        near, ratios = (
            np.clip(value * np.exp(np.linspace(-far, far, 7)), *ends).tolist()
            for value, far, ends in zip(
                best[1:3], away, ((LOWEST_HZ, HIGHEST_HZ), (1e-4, _RATIOS[-1])), strict=True
            )
        )
        best = min(best, *_points(model, near, ratios, (best.lag,) if round_ else LAGS_S))
    if rigid > _WORSE * best.cost and LOWEST_HZ < best.hertz < _SEEN_HZ and _is_like(model, best):
        return _seen(model, best)
    # None was seen. One is still possible where its fit is hardly worse than a rigid shaft's.
    possible = (
        hertz
        for hertz, point in coarse.items()
        if point.cost <= _CLEARLY * rigid
        and min(_points(model, [hertz], _RATIOS, LAGS_S)).cost <= _WORSE * rigid
    )
    low = min(next(possible, HIGHEST_HZ), _SEEN_HZ)
    inertia = 1.0 / float(model.solved(None).gains[0])
    return Mode(Bounded(low, low, HIGHEST_HZ), None, inertia)


def _points(
    model: ModeModel,
    frequencies: Sequence[float],
    ratios: Sequence[float],
    lags: Sequence[float],
) -> list[_Point]:
    """Return the squares on a grid."""
    return [
        _Point(model.solved(*each).cost, *each)
        for each in itertools.product(frequencies, ratios, lags)
    ]


def _is_like(model: ModeModel, point: _Point) -> bool:
    """Return whether the vibration has the gain of two masses when it is fitted freely."""
    gains = model.solved(*point[1:], free=True).gains
    return _GAINS[0] < -float(gains[1] / gains[0]) < _GAINS[1]


def _seen(model: ModeModel, best: _Point) -> Mode:
    hertz, ratio = (
        Bounded(
            value,
            min(value * math.exp(low), value * (1.0 - floor)),
            max(value * math.exp(high), value * (1.0 + floor)),
        )
        for value, floor, (low, high) in zip(
            best[1:3], _FLOORS, (_ends(model, best, which) for which in (0, 1)), strict=True
        )
    )
    return Mode(
        hertz,
        replace(ratio, high=min(ratio.high, max(_RATIOS[-1], ratio.value))),
        1.0 / float(model.solved(*best[1:]).gains[0]),
    )


def _ends(model: ModeModel, best: _Point, which: int) -> tuple[float, float]:
    """Return how far a value may be away, in its logarithm, where the other one gives way."""

    def fits(away: float) -> bool:
        for other in sorted(np.linspace(-1.0, 1.0, 9) * _OTHER[1 - which], key=abs):
            far = (away, other) if which == 0 else (other, away)
            hertz, ratio = best.hertz * math.exp(far[0]), best.ratio * math.exp(far[1])
            if model.solved(hertz, min(ratio, _RATIOS[-1]), best.lag).cost < _BEYOND * best.cost:
                return True
        return False

    return -_furthest(lambda far: fits(-far), which), _furthest(fits, which)


def _furthest(fits: Callable[[float], bool], which: int) -> float:
    """Return a distance a little beyond the largest that fits."""
    low, high = 0.0, _FIRST[which]
    while high < _WIDEST[which] and fits(high):
        low, high = high, 2.0 * high
    for _ in range(3):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fits(middle) else (low, middle)
    return high
