"""Measures the speed of the exact boundaries beside the gain margins of python-control."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.bench.rows import Measurement, Section, interleaved, over_rounds, ratio
from haptic_wall.controller.theory import (
    critical_stiffness,
    max_virtual_damping,
)
from haptic_wall.controller.theory.checks import FloatArray

_ROUNDS = 7
_MIXED, _COMPARED = 2_000, 25
_SAME = 1e-6
"""Relative difference up to which two answers agree."""
_NOT_A_MARGIN = 1e-9
"""A margin below it is the double pole at z = 1, repeated with a rounding error."""


def measure() -> Section:
    """Measure many mixed settings, and both programs on the same settings."""
    mixed, compared = _random(_MIXED, 1), _random(_COMPARED, 2, whole=True)
    work: dict[str, Callable[[], object]] = {"mixed": mixed.solve, "compared": compared.solve}
    notes: tuple[str, ...] = ()
    margins = _margins_by_control()
    if margins is None:
        notes = (
            "python-control is not installed, so nothing is compared with it: pip install "
            "-e '.[bench]' in the clone adds it",
        )
    else:
        work["control"] = lambda: [margins(compared, i) for i in range(_COMPARED)]
    times = interleaved(work, _ROUNDS)
    rows = [
        over_rounds(
            f"{_MIXED} mixed settings", [_MIXED / one for one in times["mixed"]], "settings/s"
        ),
    ]
    if margins is None:
        return Section(tuple(rows), notes)
    ours = compared.solve()
    theirs = np.array([margins(compared, i) for i in range(_COMPARED)])
    apart = float(np.max(np.abs(theirs / ours - 1)))
    theirs_s = [one / _COMPARED for one in times["control"]]
    if apart > _SAME:
        notes += (f"the answers differ by up to {apart:.2g}: the ratio compares different results",)
    what = f"{_COMPARED} settings of whole delays, one by one"
    rows += [
        over_rounds(
            f"python-control, all gain margins, {what}",
            [1e3 * one for one in theirs_s],
            "ms/setting",
        ),
        Measurement("largest relative difference of the two answers", apart, "1"),
        ratio(
            f"ratio of the times per setting, ours in one array of {_COMPARED}",
            times["control"],
            times["compared"],
        ),
    ]
    return Section(tuple(rows), notes)


@dataclass(frozen=True, slots=True)
class _Settings:
    """Dimensionless settings: one period long, unit inertia."""

    delta: FloatArray
    beta: FloatArray
    delay: FloatArray

    def solve(self) -> FloatArray:
        """Return their critical stiffnesses."""
        return critical_stiffness(1.0, self.delta, self.beta, 1.0, self.delay)


def _random(count: int, seed: int, whole: bool = False) -> _Settings:
    """Draw plants with delta 0.001 to 0.1, up to 5 periods of delay, B to 0.9 of the ceiling."""
    random = np.random.default_rng(seed)
    delta = 10 ** random.uniform(-3, -1, count)
    delay = random.uniform(0, 5, count)
    delay = np.floor(delay) if whole else delay
    ceiling = max_virtual_damping(1.0, delta, 1.0, delay)
    return _Settings(delta, random.uniform(0, 0.9, count) * ceiling, delay)


def _margins_by_control() -> Callable[[_Settings, int], float] | None:
    """Return python-control's least gain margin of one setting as a function; None: not installed.

    ``stability_margins`` must be asked for all crossings: the single one it returns by default is
    the nearest to 1, not the least.

    Source: Gil et al., ICRA 2007, eq. (15).
    """
    try:
        control = importlib.import_module("control")
    except ImportError:
        return None

    def margin(settings: _Settings, i: int) -> float:
        delta, beta = float(settings.delta[i]), float(settings.beta[i])
        late = np.zeros(int(settings.delay[i]) + 1)
        eps = np.exp(-delta)
        plant = np.array([delta + np.expm1(-delta), -np.expm1(-delta) - delta * eps]) / delta**2
        damped = np.polyadd(
            np.concatenate([np.poly([1.0, eps]), late]), beta * np.polymul(plant, [1.0, -1.0])
        )
        loop = control.tf(np.polymul(plant, [1.0, 0.0]), damped, 1.0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it divides by zero at the poles z = 1
            margins = np.asarray(control.stability_margins(loop, returnall=True)[0])
        return float(np.min(margins[margins > _NOT_A_MARGIN]))

    return margin
