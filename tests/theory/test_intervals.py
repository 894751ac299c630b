"""Discs with derivatives: they hold every value and slope found by sampling, and shrink."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import quad

from haptic_wall.controller.theory.intervals import Jet, decay_moments, turn_mean, turned, variables

FUNCTIONS: dict[str, tuple[Callable[[Jet, Jet], Jet], Callable[[float, float], complex]]] = {
    "sum": (lambda x, y: x + y.scaled(2j), lambda x, y: x + 2j * y),
    "difference": (lambda x, y: (x - y).plus(3.0), lambda x, y: x - y + 3),
    "product": (lambda x, y: x * y * x, lambda x, y: x * y * x),
    "conjugate": (
        lambda x, y: (x.scaled(1j) * y.plus(1.0)).conjugate(),
        lambda x, y: -1j * x * (y + 1),
    ),
    "turned": (lambda x, y: turned(x * y, -3.0), lambda x, y: np.exp(-3j * x * y)),
    "turn_mean": (
        lambda x, y: turn_mean(x * y),
        lambda x, y: complex(
            quad(lambda s: np.cos(s * x * y), 0, 1)[0], quad(lambda s: np.sin(s * x * y), 0, 1)[0]
        ),
    ),
    "speed": (
        lambda x, y: decay_moments(x * y)[0],
        lambda x, y: quad(lambda s: np.exp(-x * y * s), 0, 1, epsabs=1e-13)[0],
    ),
    "torque": (
        lambda x, y: decay_moments(x * y)[1],
        lambda x, y: quad(lambda s: (1 - s) * np.exp(-x * y * s), 0, 1, epsabs=1e-13)[0],
    ),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_jet_holds_every_value_and_slope_over_its_box(name: str) -> None:
    jet, plain = FUNCTIONS[name]
    random = np.random.default_rng(1)
    # products from below the Taylor bound to above the asymptote
    centre = 10 ** random.uniform([[-2], [-2]], [[1], [1]], (2, 40))
    half = centre * random.uniform(0, 0.3, (2, 40))
    around = jet(*variables(centre, half, True))
    at = jet(*variables(centre, 0 * half, False))
    for i in range(40):
        middle = plain(*centre[:, i])
        assert abs(middle - at.centre[0, i]) < 1e-11 * max(abs(middle), 1)
        for point in random.uniform(centre[:, i] - half[:, i], centre[:, i] + half[:, i], (5, 2)):
            value = plain(*point)
            assert abs(value - around.centre[0, i]) <= around.radius[0, i] + 1e-12
            for k in range(2):
                step = np.zeros(2)
                step[k] = 1e-5 * point[k]
                slope = (plain(*(point + step)) - plain(*(point - step))) / (2 * step[k])
                # differences have an error of their own
                slack = 1e-6 * max(abs(slope), 1 / point[k])
                assert abs(slope - around.centre[1 + k, i]) <= around.radius[1 + k, i] + slack
