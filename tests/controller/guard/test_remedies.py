"""The gain of each improvement, against the limits of the theory evaluated directly."""

from __future__ import annotations

from typing import Any

import pytest

from haptic_wall.controller.guard.belief import Bounded
from haptic_wall.controller.guard.limits import OneSided
from haptic_wall.controller.guard.remedies import Wall, remedies
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.theory import (
    critical_stiffness,
    linear_limit,
    one_sided_limit,
)
from tests.support.beliefs import belief

M, B_VISCOUS, T = 0.012, 0.0117, 1e-3
CORNER = OneSided.CORNER_ALONE
EVERY = GuardSettings(mode="off")


def situation(**changes: Any) -> Situation:
    return Situation(belief(**{"inertia": M, "damping": B_VISCOUS} | changes), T, 4.1, 0.0)


def limit(m: float, b: float, t_d: float = 2e-3, one_sided: float = 1.0) -> float:
    """The smallest limit of B = 0.1 by the theory's own functions."""
    loop = (0.1, T, t_d)
    thrown = one_sided * one_sided_limit(m, b, *loop)
    return float(min(linear_limit(b, *loop), critical_stiffness(m, b, *loop), thrown))


def test_each_remedy_is_the_limit_with_that_one_thing_changed() -> None:
    where = situation(inertia=Bounded(M, 0.01, 0.014), damping=Bounded(B_VISCOUS, 0.006, 0.02))
    parts = {"one": 1.2e-3, "other": 0.8e-3}
    found = remedies(Wall(Request(0.0, 0.1, "above"), EVERY, where, parts), Work())
    expected = {
        "a delay (one) of 0.6 ms": limit(0.01, 0.006, 1.4e-3, CORNER),
        "a two-sided wall": min(
            linear_limit(0.006, 0.1, T, 2e-3), critical_stiffness(0.01, 0.006, 0.1, T, 2e-3)
        ),
        "the servo known exactly": limit(M, B_VISCOUS),
    }
    for words, stiffness in expected.items():
        (remedy,) = [each for each in found if each.text.startswith(words)]
        assert remedy.stiffness == pytest.approx(stiffness, rel=0.02), words  # the table's jags


def test_damping_that_helps_is_found_where_little_is_asked_for() -> None:
    """With a link whose vibration formulas count at a small damping, and a grid at a larger one."""
    link = situation(
        inertia=Bounded(M, 0.0117, 0.0122),
        damping=Bounded(B_VISCOUS, 0.0111, 0.0123),
        load_inertia=Bounded(0.00176, 0.00035, 0.006),
        flexible_hz=Bounded(290.0, 168.0, 500.0),
        flexible_damping_ratio=Bounded(0.02, 0.005, 0.1),
    )
    parts = {"one": 6e-5}
    one, other = (
        remedies(Wall(Request(0.0, damping, "above"), GuardSettings(), link, parts), Work())[0]
        for damping in (0.0, 0.06)
    )
    assert one.text.startswith("virtual damping")
    assert one.stiffness == pytest.approx(other.stiffness, rel=0.05)
