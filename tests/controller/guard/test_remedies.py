"""The gain of each improvement, against the limits of the theory evaluated directly."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.guard.delay_parts import (
    DelayParts,
)
from haptic_wall.controller.guard.limits import OneSided
from haptic_wall.controller.guard.remedies import Remedy, Wall, remedies
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.theory import (
    critical_stiffness,
    linear_limit,
    one_sided_limit,
)

M, B_VISCOUS, T = 0.012, 0.0117, 1e-3
TORQUE, CORNER = 4.1, OneSided.CORNER_ALONE
EVERY = GuardSettings(mode="off")


def situation(position_step: float = 0.0, **changes: Any) -> Situation:
    belief = Belief(
        inertia=Bounded.exactly(M),
        damping=Bounded.exactly(B_VISCOUS),
        coulomb=Bounded.exactly(0.0),
        delay=Bounded.exactly(0.0),
        torque_gain=Bounded.exactly(1.0),
    )
    return Situation(replace(belief, **changes), T, TORQUE, position_step)


def bought(where: Situation, delay: dict[str, float], change: str) -> list[Remedy]:
    """Limits of a one-sided wall with B = 0.1 after a change."""
    wall = Wall(Request(0.0, 0.1, "above"), EVERY, where, DelayParts(where.period, delay))
    return remedies(wall, [change], Work())


def limit(m: float, b: float, t_d: float = 2e-3, one_sided: float = 1.0) -> float:
    """The smallest limit of B = 0.1 by the theory's own functions."""
    loop = (0.1, T, t_d)
    thrown = one_sided * one_sided_limit(m, b, *loop)
    return float(min(linear_limit(b, *loop), critical_stiffness(m, b, *loop), thrown))


def test_each_remedy_is_the_limit_with_that_one_thing_changed() -> None:
    where = situation(inertia=Bounded(M, 0.01, 0.014), damping=Bounded(B_VISCOUS, 0.006, 0.02))
    delay = {"one": 1.2e-3, "other": 0.8e-3}
    expected = {
        "damping": limit(0.01, 0.012, one_sided=CORNER),
        "largest_part": limit(0.01, 0.006, 1.4e-3, CORNER),
        "two_sided": min(
            linear_limit(0.006, 0.1, T, 2e-3), critical_stiffness(0.01, 0.006, 0.1, T, 2e-3)
        ),
        "belief": limit(M, B_VISCOUS),
    }
    for change, stiffness in expected.items():
        (remedy,) = bought(where, delay, change)
        assert remedy.stiffness == pytest.approx(stiffness, rel=0.02), change  # the table's jags
    assert bought(where, delay, "encoder") == []
