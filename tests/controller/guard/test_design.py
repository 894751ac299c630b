"""The gain of each improvement, against the limits of the theory evaluated directly."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.guard.delay_parts import (
    SAMPLE_AGE,
    DelayParts,
    shorter,
)
from haptic_wall.controller.guard.design import Change, Improvement, Wall, improvements
from haptic_wall.controller.guard.evaluation import Evaluation
from haptic_wall.controller.guard.limits import OneSided, evaluate
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.theory import (
    critical_stiffness,
    linear_limit,
    one_sided_limit,
)

M, B_VISCOUS, T = 0.012, 0.0117, 1e-3
TORQUE = 4.1
EVERY = GuardSettings(mode="off")
ALL: tuple[Change, ...] = (
    "virtual_damping", "largest_part", "delay", "rate", "damping",
    "encoder", "two_sided", "belief",
)  # fmt: skip


def situation(position_step: float = 0.0, **changes: Any) -> Situation:
    belief = Belief(
        inertia=Bounded.exactly(M),
        damping=Bounded.exactly(B_VISCOUS),
        coulomb=Bounded.exactly(0.0),
        delay=Bounded.exactly(0.0),
        torque_gain=Bounded.exactly(1.0),
    )
    return Situation(replace(belief, **changes), T, TORQUE, position_step)


def bought(
    where: Situation,
    delay: dict[str, float],
    damping: float,
    side: Side = "above",
    changes: tuple[Change, ...] = ALL,
) -> tuple[float, dict[str, Improvement]]:
    """The stiffness as it is, and what each change makes of it."""
    parts = DelayParts(where.period, delay)
    wall = Wall(Request(0.0, damping, side), EVERY, where, parts)
    found = evaluate(Evaluation(wall.request, EVERY, where, wall.corner, exact=True))
    answer = improvements(wall, changes, exact=True)
    assert [each.stiffness for each in answer] == sorted(
        (each.stiffness for each in answer), reverse=True
    )
    return float(found.smallest()[0]), {each.change: each for each in answer}


def counted(m: float, b: float, t: float = T, t_d: float = 2e-3) -> float:
    """``limit`` at B = 0.1 for a corner with little friction, as the guard takes it."""
    return float(
        min(
            linear_limit(b, 0.1, t, t_d),
            critical_stiffness(m, b, 0.1, t, t_d),
            OneSided.CORNER_ALONE * one_sided_limit(m, b, 0.1, t, t_d, 1, 1e-3),
        )
    )


def limit(
    m: float = M, b: float = B_VISCOUS, damping: float = 0.1, t: float = T, t_d: float = 2e-3
) -> float:
    """The smallest limit of a one-sided wall without an encoder, by the theory's own functions."""
    return float(
        min(
            linear_limit(b, damping, t, t_d),
            critical_stiffness(m, b, damping, t, t_d),
            one_sided_limit(m, b, damping, t, t_d),
        )
    )


def test_each_change_is_the_limit_with_that_one_thing_changed() -> None:
    where = situation(inertia=Bounded(M, 0.01, 0.014), damping=Bounded(B_VISCOUS, 0.006, 0.02))
    delay = {"adapter": 1.2e-3, "rest": 0.8e-3}
    now, found = bought(where, delay, 0.1)
    box = {"m": 0.01, "b": 0.006}
    # jags of the table; the changes here make 20 % and more
    jags = 0.01
    assert now == pytest.approx(counted(**box), rel=jags)
    expected = {
        "delay": counted(**box, t_d=1e-3),
        "rate": counted(**box, t=T / 2),
        "damping": counted(box["m"], 0.012),
        "largest_part": counted(**box, t_d=1.4e-3),
        "two_sided": min(
            linear_limit(0.006, 0.1, T, 2e-3), critical_stiffness(0.01, 0.006, 0.1, T, 2e-3)
        ),
    }
    for change, stiffness in expected.items():
        assert found[change].stiffness == pytest.approx(stiffness, rel=jags), change
    # the one-sided limit of one plant is found to a few 1e-4
    assert found["belief"].stiffness == pytest.approx(limit(), rel=1e-3)
    assert "encoder" not in found


@pytest.mark.parametrize(
    ("named", "slow", "least"),
    [
        ({SAMPLE_AGE: 30e-3}, True, T + 1e-3),
        ({SAMPLE_AGE: 30e-3}, False, 15e-3),
        ({SAMPLE_AGE: 3e-3}, True, 1.5e-3),
        ({SAMPLE_AGE: 2e-3, "device": 5e-3}, True, 2.5e-3),
    ],
)
def test_a_sample_kept_back_would_be_a_short_timer_old(
    named: dict[str, float], slow: bool, least: float
) -> None:
    """Elsewhere half is tried; with 1 ms of period and timer each the age is 2 ms at most."""
    assert shorter(DelayParts(T, named), slow) == pytest.approx(least)
