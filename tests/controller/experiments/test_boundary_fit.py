import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.identify.boundary_fit import (
    BoundaryPoints,
    KnownLoop,
    fit_boundary,
    read_points,
)
from haptic_wall.controller.theory import critical_point
from haptic_wall.controller.theory.checks import FloatArray
from tests.typed import not_none

M, B, C, T = 0.0018142, 0.0036617, 0.012833, 1e-3
LATE = 0.0013
"""What the delay is longer than believed [s]"""


def points(
    dampings: Sequence[float] | FloatArray,
    delays: Sequence[float] | FloatArray,
    coulomb: float = 0.0,
    kick: float = 0.05,
    noise: float = 0.0,
    seed: int = 0,
) -> BoundaryPoints:
    """Measured as theory says they are, friction as damping at the kick, with noise."""
    virtual, delay = (a.ravel() for a in np.meshgrid(dampings, delays))
    helped = np.zeros(virtual.shape)
    for _ in range(30):  # friction helps by the frequency, which it changes
        at = critical_point(M, B + helped, virtual, T, delay + LATE)
        helped = 4.0 * coulomb / (math.pi * kick * math.tau * at.frequency)
    factor = 1.0 + noise * np.random.default_rng(seed).standard_normal(virtual.shape)
    stiffness = at.stiffness * factor
    return BoundaryPoints(
        virtual,
        delay,
        stiffness,
        np.full(virtual.shape, max(noise, 1e-4)) * stiffness,
        at.frequency,
        np.full(virtual.shape, kick),
    )


def loop(coulomb: float = 0.0, lag: float = 0.001) -> KnownLoop:
    return KnownLoop(M, coulomb, T, 1, lag)


def test_the_boundary_gives_back_damping_and_delay() -> None:
    fit = fit_boundary(points([0.0, 0.02, 0.05, 0.1, 0.2], [0.002, 0.005]), loop())
    assert fit.damping.value == pytest.approx(B, rel=1e-3)
    assert fit.delay.value == pytest.approx(0.001 + LATE, abs=1e-6)
    assert fit.used == 10


def test_the_straight_part_alone_says_nearly_the_same() -> None:
    fit = fit_boundary(points([0.0, 0.004, 0.008, 0.012, 0.1], [0.002]), loop())
    assert 3 <= fit.straight < 5
    # The line lies up to 2 % off where it counts as straight.
    assert not_none(fit.line_delay).value == pytest.approx(0.001 + LATE, abs=0.1e-3)
    assert not_none(fit.line_damping).value == pytest.approx(B, rel=0.03)


def test_friction_counts_as_the_damping_that_it_is() -> None:
    measured = points([0.0, 0.02, 0.05, 0.1], [0.002, 0.004], coulomb=C)
    assert fit_boundary(measured, loop(C)).damping.value == pytest.approx(B, rel=1e-3)
    assert fit_boundary(measured, loop(0.0)).damping.value > 1.3 * B


def test_unmeasured_points_are_left_out_and_too_few_are_told(tmp_path: Path) -> None:
    path = tmp_path / "sweep.json"
    listed = [
        {"virtual_damping": b, "delay_s": 0.002, "measured": k, "uncertainty": None}
        for b, k in ((0.0, 1.0), (0.1, None), (0.1, 20.0), (0.2, 30.0))
    ]
    path.write_text(json.dumps({"points": listed}))
    found, config = read_points(path)
    assert found.stiffness.tolist() == [1.0, 20.0, 30.0]
    assert config is None
    path.write_text(json.dumps({"points": listed[:2]}))
    with pytest.raises(UserError, match="found 1 measured points"):
        read_points(path)


@pytest.mark.parametrize("text", ["{", "[]", '{"points": [{"measured": 1}]}', '{"points": 3}'])
def test_a_file_that_is_no_sweep_is_told(tmp_path: Path, text: str) -> None:
    path = tmp_path / "sweep.json"
    path.write_text(text)
    with pytest.raises(UserError, match="--from-sweep"):
        read_points(path)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("measured", 10**400),
        ("delay_s", -0.001),
        ("uncertainty", float("inf")),
    ],
)
def test_figures_that_no_servo_has_are_told(tmp_path: Path, name: str, value: float) -> None:
    path = tmp_path / "sweep.json"
    listed = [
        {"virtual_damping": b, "delay_s": 0.002, "measured": k, "uncertainty": None}
        for b, k in ((0.0, 1.0), (0.05, 10.0), (0.1, 20.0))
    ]
    listed[1][name] = value
    path.write_text(json.dumps({"points": listed}))
    with pytest.raises(UserError, match="--from-sweep"):
        read_points(path)
