"""The guard's limits hold for every servo that the belief admits, not only at one corner."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_wall.controller.guard.belief import Bounded
from haptic_wall.controller.guard.evaluation import Evaluation
from haptic_wall.controller.guard.guard import decide
from haptic_wall.controller.guard.limits import evaluate, least_of, smallest
from haptic_wall.controller.guard.plants import Plants, members
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from haptic_wall.controller.theory import (
    max_virtual_damping,
    one_sided_limit,
    passive_limit,
)
from haptic_wall.controller.theory.boundary import chain_boundary
from haptic_wall.controller.theory.chain import one_mass
from haptic_wall.controller.theory.velocity_filter import VelocityFilter
from tests.support.beliefs import belief
from tests.support.contacts import restitution

T = 1e-3
M = 0.01


def situation(
    damping: tuple[float, float],
    inertia: tuple[float, float] = (M, M),
    gain: tuple[float, float] = (1.0, 1.0),
    delay: tuple[float, float] = (0.0, 0.0),
) -> Situation:
    """Damping as b T / m at the lowest inertia, delay in periods."""
    unit = inertia[0] / T
    servo = belief(
        inertia=Bounded(inertia[0], *inertia),
        damping=Bounded(damping[0] * unit, damping[0] * unit, damping[1] * unit),
        delay=Bounded(delay[0] * T, delay[0] * T, delay[1] * T),
        torque_gain=Bounded(gain[0], *gain),
    )
    return Situation(servo, T, torque_limit=100.0, position_step=0.0)


@pytest.mark.parametrize(("believed", "true"), [(0.15, 0.56), (0.20, 0.69)])
def test_a_servo_with_more_damping_than_the_least_believed_comes_back_no_faster(
    believed: float, true: float
) -> None:
    """Decided for the least damping alone these walls return 1.016 and 1.161 times the speed."""
    where = situation((believed, 4 * believed))
    ceiling = float(max_virtual_damping(M, believed * M / T, T, 0.0))
    (decision,) = decide(Request(1e9, 0.7 * ceiling, "above"), GuardSettings(), where, [0.0])
    assert decision.damping == pytest.approx(0.7 * ceiling)
    if decision.stiffness == 0:
        return  # no stiffness at all holds for the worst of them
    returned = restitution(M, true * M / T, decision.stiffness, decision.damping, T, 0.0)
    assert returned <= 1.0


def test_the_members_begin_with_the_corner_and_reach_the_ends_of_the_belief() -> None:
    """None is beyond them: what is not believed would cost stiffness."""
    where = situation((0.2, 0.8), inertia=(M, 1.3 * M), gain=(0.8, 1.25))
    corner = Plants.at_corner(where, np.zeros(1))
    box = members(corner, where, Request(0.0, 0.0, "above"))
    ends = np.array([[M, 1.3 * M], [0.2 * M / T, 0.8 * M / T], [0.8, 1.25]])
    found = np.array([box.inertia, box.damping, box.gain])
    assert found[:, 0] == pytest.approx([M, 0.2 * M / T, 1.25])
    np.testing.assert_allclose(found.min(axis=1), ends[:, 0])
    np.testing.assert_allclose(found.max(axis=1), ends[:, 1])


def test_what_no_stiffness_makes_safe_for_some_servo_in_the_box_is_given_none() -> None:
    """The damper alone throws a device back that has slowed down much within a period."""
    where = situation((0.24, 0.96), delay=(0.05, 0.05))
    ceiling = float(max_virtual_damping(M, 0.24 * M / T, T, 0.05 * T))
    damping = 0.63 * ceiling
    assert one_sided_limit(M, 0.936 * M / T, damping, T, 0.054 * T) == 0
    (decision,) = decide(Request(1e9, damping, "above"), GuardSettings(), where, [0.0])
    assert decision.stiffness == 0


@pytest.mark.parametrize("heavier", [1.3, 1.5, 1.6, 2.0])
def test_a_heavier_servo_is_stable_with_a_velocity_over_many_samples(heavier: float) -> None:
    """Decided for the lightest servo alone, this wall has 1.55 times the limit of another."""
    where, samples = situation((0.0877, 0.0877), inertia=(M, 2.0 * M)), 16
    request, settings = Request(1e9, 1e9, "both", samples), GuardSettings(damping_cap=0.3)
    (decision,) = decide(request, settings, where, [0.0])
    chain = one_mass(heavier * M, 0.0877 * M / T)
    limit = float(chain_boundary(*chain, decision.damping, T, 0.0, samples).stiffness)
    assert decision.stiffness < limit


@pytest.mark.parametrize("heavier", [1.05, 1.15, 1.5, 1.8])
def test_a_heavier_servo_is_stable_with_a_low_pass(heavier: float) -> None:
    """Decided for the lightest servo alone, this wall has up to seven times its limit."""
    where = situation((0.065, 0.065), (M, 1.8 * M), delay=(2.67, 2.67))
    lowpass = VelocityFilter("lowpass", 0.0402, 0.32)
    request = Request(1e9, 1e9, "both", velocity_filter=lowpass)
    (decision,) = decide(request, GuardSettings(margin=0.99, damping_cap=0.99), where, [0.0])
    chain = one_mass(heavier * M, 0.065 * M / T)
    limit = float(chain_boundary(*chain, decision.damping, T, 2.67 * T, 1, lowpass).stiffness)
    assert 0.0 < decision.stiffness < limit


# found by search: b T/m at the corner, B of the ceiling, delay; inertia and gain of the member
JAGS = [
    (0.1, 0.039, 0.0, 1.095, 1.0),
    (0.0721, 0.125, 0.0, 1.173, 1.0),
    (0.0658, 0.132, 0.0, 1.107, 0.984),
    (0.6061, 0.200, 0.0, 1.229, 1.0),
    (0.5881, 0.213, 0.0, 1.280, 1.0),
    (1.0, 0.492, 6.463, 1.625, 1.0),
    (0.004, 0.073, 0.0, 1.015, 0.933),
]


@pytest.mark.parametrize(("damping", "share", "delay", "heavier", "weaker"), JAGS)
def test_a_heavier_servo_is_within_what_is_counted_with(
    damping: float, share: float, delay: float, heavier: float, weaker: float
) -> None:
    where = situation((damping, damping), (M, 2.25 * M), (0.5, 1.0), (delay, delay))
    virtual = share * float(max_virtual_damping(M, damping * M / T, T, delay * T))
    (decision,) = decide(Request(1e9, virtual, "above"), GuardSettings(), where, [0.0])
    counted = smallest(decision.limits)[1]
    unit = damping * M / T / (heavier * M / T)
    member = situation((unit, unit), (heavier * M,) * 2, (weaker, weaker), (delay, delay))
    asked = (Request(0.0, virtual, "above"), GuardSettings(mode="off"), member)
    true = evaluate(Evaluation(*asked, Plants.at_corner(member, np.zeros(1)), exact=True))
    assert counted <= float(least_of(true)[0]) * (1 + 1e-3)


def test_a_shorter_delay_than_the_longest_may_be_the_least_passive() -> None:
    b = 0.01
    where = situation((b * T / M, b * T / M), delay=(0.0, 0.25))
    settings = GuardSettings(mode="passive")
    (decision,) = decide(Request(1e9, 0.5 * b, "both"), settings, where, [0.0])
    at_once = passive_limit(b, 0.5 * b, T, 0.0)
    assert passive_limit(b, 0.5 * b, T, 0.25 * T) > 1.3 * at_once
    assert decision.limits["passive"] == pytest.approx(at_once)


def test_a_servo_that_is_known_loses_nothing() -> None:
    where = situation((0.01, 0.01), delay=(1.0, 1.0))
    (decision,) = decide(Request(1e9, 0.1, "above"), GuardSettings(), where, [0.0])
    computed = float(one_sided_limit(M, 0.01 * M / T, 0.1, T, T))
    assert decision.limits["one_sided"] == pytest.approx(computed, rel=0.01)
