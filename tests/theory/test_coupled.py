"""Hands on the device: exact limits against poles, and verdicts over ranges of hands."""

from __future__ import annotations

import math

import numpy as np
import pytest

from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from haptic_wall.controller.theory.coupled import Hand, coupled_limit, is_stable
from haptic_wall.controller.theory.hand_boxes import Box, HeldWall, doubt
from haptic_wall.controller.theory.hands import HandRange, stable_hands
from tests.theory.oracles import Loop, radius

PERIOD = 1e-3


def loop_with(
    hand: Hand, inertia: float, damping: float, wall: tuple[float, float], delay: float, n: int = 1
) -> Loop:
    mass, damper, spring = (
        float(np.asarray(each)) for each in (hand.mass, hand.damping, hand.stiffness)
    )
    return Loop(inertia + mass, damping + damper, *wall, PERIOD, delay, n, spring)


def test_the_poles_cross_at_the_limit_and_not_before(thorough: bool, wholly: bool) -> None:
    random = np.random.default_rng(1)
    count, found = 3000 if thorough else 80 if wholly else 30, 0
    for _ in range(count):
        m = 10 ** random.uniform(-3, 0)
        b, delay = m * 10 ** random.uniform(-2, 1.5), random.uniform(0, 6) * PERIOD
        n = int(random.integers(1, 4))
        big_b = random.uniform(-0.3, 0.6) * m / PERIOD * 10 ** random.uniform(-3, 0)
        mass = m * 10 ** random.uniform(-1, 1)
        # springs from soft to one that resonates at half of the sampling rate
        spring = (m + mass) / PERIOD**2 * 10 ** random.uniform(-6, 0.9)
        hand = Hand(mass, b * float(random.integers(0, 2)), spring)
        k = float(coupled_limit(m, b, big_b, PERIOD, delay, hand, n))
        if k == 0:
            loop = loop_with(hand, m, b, (1e-9 * m / PERIOD**2, big_b), delay, n)
            assert radius(loop) > 1 - 1e-10
            continue
        found += 1
        loop = loop_with(hand, m, b, (k, big_b), delay, n)
        assert radius(loop._replace(stiffness=k * (1 + 1e-6))) > 1
        for share in (0.02, 0.3, 0.6, 0.9, 1 - 1e-6):
            assert radius(loop._replace(stiffness=k * share)) < 1
    assert found > min(40, count / 2)


def test_without_a_hand_it_is_the_critical_stiffness() -> None:
    delay, big_b = np.array([0.0, 1.3e-3, 5e-3])[:, None], np.array([0.0, 0.02, 1.0])
    np.testing.assert_allclose(
        coupled_limit(0.01, 0.01, big_b, PERIOD, delay, Hand()),
        critical_stiffness(0.01, 0.01, big_b, PERIOD, delay),
        rtol=1e-9,
    )


def test_a_mere_mass_and_damper_are_a_device_with_more_of_them() -> None:
    hand = Hand(mass=[0.0, 0.02, 0.3], damping=0.04)
    np.testing.assert_allclose(
        coupled_limit(0.01, 0.01, 0.1, PERIOD, 2.4e-3, hand),
        critical_stiffness(np.array([0.01, 0.03, 0.31]), 0.05, 0.1, PERIOD, 2.4e-3),
        rtol=1e-9,
    )


def test_an_undamped_spring_destabilises_a_stable_wall() -> None:
    # half of the ceiling is stable for a free device up to a large stiffness; a spring moves the
    # oscillation to where the delayed damper pushes with the motion
    m, b, delay = 0.012, 0.0117, 2e-3
    big_b = 0.5 * float(max_virtual_damping(m, b, PERIOD, delay))
    k = 0.5 * float(critical_stiffness(m, b, big_b, PERIOD, delay))
    assert radius(Loop(m, b, k, big_b, PERIOD, delay)) < 1
    assert radius(Loop(m, b, k, big_b, PERIOD, delay, 1, hand_stiffness=4e3)) > 1
    verdict = stable_hands(m, b, k, big_b, PERIOD, delay, HandRange(stiffness=(0.0, 4e3)))
    assert verdict.stable is False
    assert radius(loop_with(verdict.worst, m, b, (k, big_b), delay)) > 1
    assert verdict.limit < k


@pytest.mark.whole
def test_a_verdict_holds_for_every_hand_of_the_range(thorough: bool) -> None:
    random = np.random.default_rng(7)
    verdicts = []
    for _ in range(60 if thorough else 4):
        m, b = 10 ** random.uniform(-2.5, -1), 10 ** random.uniform(-2.3, -1.5)
        delay = random.uniform(0, 4) * PERIOD
        big_b = random.uniform(0, 0.3) * float(max_virtual_damping(m, b, PERIOD, delay))
        k = random.uniform(0.2, 1) * float(critical_stiffness(m, b, big_b, PERIOD, delay))
        least = random.uniform(0, 0.3)
        hands = HandRange((0.0, m), (least, 2.0), (0.0, 10 ** random.uniform(-1, 1) * k))
        verdict = stable_hands(m, b, k, big_b, PERIOD, delay, hands, effort=30)
        verdicts.append(verdict.stable)
        if verdict.stable is False:
            assert radius(loop_with(verdict.worst, m, b, (k, big_b), delay)) >= 1
        for i in range(60):
            hand = Hand(
                random.uniform(*hands.mass),
                least * 10 ** random.uniform(0, 1) if random.random() < 0.5 else least,
                random.uniform(*hands.stiffness),
            )
            if verdict.stable:
                assert radius(loop_with(hand, m, b, (k, big_b), delay)) < 1
            if verdict.stable is not False and i < 4:
                worst = verdict.limit * (1 - 1e-3)
                assert coupled_limit(m, b, big_b, PERIOD, delay, hand) > min(worst, k)
    assert verdicts.count(True) >= 2
    assert verdicts.count(False) >= 1


def test_more_damping_of_the_hand_helps_where_a_spring_alone_destabilises() -> None:
    m, b, delay = 0.012, 0.0117, 2e-3
    big_b = 0.5 * float(max_virtual_damping(m, b, PERIOD, delay))
    k = 0.5 * float(critical_stiffness(m, b, big_b, PERIOD, delay))
    damped = HandRange(damping=(6.0, 20.0), stiffness=(0.0, 4e3))
    assert stable_hands(m, b, k, big_b, PERIOD, delay, damped).stable


def test_errors_name_the_argument() -> None:
    with pytest.raises(ValueError, match=r"hand\.stiffness must be >= 0, got -1"):
        coupled_limit(0.01, 0.01, 0.0, PERIOD, 0.0, Hand(stiffness=-1.0))
    with pytest.raises(ValueError, match="delay must be finite"):
        coupled_limit(0.01, 0.01, 0.0, PERIOD, math.nan, Hand())
    with pytest.raises(ValueError, match=r"hands\.mass must not fall, got 2 to 1"):
        stable_hands(0.01, 0.01, 1.0, 0.0, PERIOD, 0.0, HandRange(mass=(2.0, 1.0)))
    with pytest.raises(ValueError, match="damping must be > 0, got 0"):
        stable_hands(0.01, 0.0, 1.0, 0.0, PERIOD, 0.0, HandRange())


@pytest.mark.parametrize(
    ("delay", "damping", "big_b"),
    # slow and damped: far below what wall and mass alone would oscillate at
    [(0.1, 60.0, 0.0), (0.1, 60.0, -0.1), (0.02, 60.0, 0.0), (1e-3, 0.01, -0.0109)],
)
def test_a_hand_with_a_pole_on_the_circle_is_never_excluded(
    delay: float, damping: float, big_b: float
) -> None:
    m = b = 1e-3
    hand = Hand(damping=damping)
    k = float(coupled_limit(m, b, big_b, PERIOD, delay, hand))
    point = Box((m, m), (b + damping, b + damping), (0.0, 0.0))
    found = doubt(HeldWall(m, b, k, big_b, PERIOD, delay, 1), point)
    assert found is not None
    assert doubt(HeldWall(m, b, 0.9 * k, big_b, PERIOD, delay, 1), point) is None


def test_wrong_hands_are_refused_by_name() -> None:
    device = (0.01, 0.01, 10.0, 0.1, PERIOD, 1e-3)
    with pytest.raises(ValueError, match=r"hands\.mass must be a pair"):
        stable_hands(*device, HandRange(mass=(0.0, 1.0, 2.0)))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"hand\.mass must be one number"):
        is_stable(*device, Hand(mass=[0.0, 1.0]))
    with pytest.raises(ValueError, match=r"delay must be >= 0"):
        is_stable(0.01, 0.01, 10.0, 0.1, PERIOD, -1e-3, Hand())
