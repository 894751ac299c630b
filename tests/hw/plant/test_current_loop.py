"""The current loop: from a command to the torque that acts, held against an integrator."""

import math
import random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_wall.hw.plant.current_loop import STEP_NS
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.truth import TrueServo
from tests.cases import sampled

MS = 1_000_000
STALL, NO_LOAD = 4.1, 4.82


def servo(**values: Any) -> TrueServo:
    return TrueServo(**{"inertia": 0.012, "counts_per_rev": 0, "no_load_speed": NO_LOAD, **values})


def played(true: TrueServo, goals: list[float], period_ns: int = MS) -> list[tuple[float, ...]]:
    """Position, velocity and torque at the end of each goal's period."""
    mechanism = Mechanism(true, 0)
    states: list[tuple[float, ...]] = []
    for k, goal in enumerate(goals):
        mechanism.command(goal, k * period_ns)
        mechanism.advance((k + 1) * period_ns)
        states.append((mechanism.position, mechanism.velocity, mechanism.torque))
    return states


def exponential(
    inertia: float, rate: float, goals: list[float]
) -> list[tuple[float, float, float]]:
    """A free body under a torque that tends to each goal for a millisecond, in closed form."""
    x = v = torque = 0.0
    states = []
    for goal in goals:
        t, gap = 1e-3, torque - goal
        once = -math.expm1(-rate * t) / rate
        x += v * t + (goal * t * t / 2.0 + gap * (t - once) / rate) / inertia
        v += (goal * t + gap * once) / inertia
        torque = goal + gap * math.exp(-rate * t)
        states.append((x, v, torque))
    return states


@given(
    bandwidth=st.floats(5.0, 3000.0),
    inertia=st.floats(0.001, 0.1),
    goals=st.lists(st.floats(-4.0, 4.0), min_size=2, max_size=12),
)
def test_the_lag_stays_within_its_stated_error(
    bandwidth: float, inertia: float, goals: list[float]
) -> None:
    true = servo(inertia=inertia, current_bandwidth=bandwidth)
    exact = exponential(inertia, math.tau * bandwidth, goals)
    bound = max(map(abs, goals)) * (STEP_NS * 1e-9) ** 2 / (12.0 * inertia)
    for (position, velocity, torque), (x, v, wanted) in zip(
        played(true, goals), exact, strict=True
    ):
        assert abs(position - x) <= 1.001 * bound + 1e-12
        assert velocity == pytest.approx(v, rel=1e-9, abs=1e-9)
        assert torque == pytest.approx(wanted, abs=1e-11)


@pytest.mark.parametrize(
    ("values", "near"),
    sampled([({"back_emf": True}, 0.0), ({"current_bandwidth": 150.0}, 0.0), ({}, 1e-10)], 2),
)
def test_the_instants_at_which_it_is_looked_at_do_not_matter(
    values: dict[str, Any], near: float
) -> None:
    """To the bit where a current loop is computed, which has steps of its own."""
    true = servo(
        damping=0.01,
        coulomb=0.09,
        delay=0.7e-3,
        backlash=0.004,
        hand="tap",
        **values,
    )
    rng = random.Random(3)
    often, seldom = (Mechanism(true, 0) for _ in range(2))
    for mechanism in (often, seldom):
        mechanism.engage_operator(123_457)
    for k in range(1500):
        now_ns = k * MS
        looks = [rng.randrange(now_ns, now_ns + MS) for _ in range(3)]
        if k == 1000:
            looks.append(now_ns + 130_000)  # just after the operator's start
        for time_ns in sorted(looks):
            often.advance(max(time_ns, often.time_ns))
        torque, sent_ns = rng.uniform(-0.6, 0.6), now_ns + MS + rng.randrange(90_000)
        often.command(torque, sent_ns)
        seldom.command(torque, sent_ns)
        assert often.measured()[0] == pytest.approx(seldom.measured()[0], rel=0.0, abs=near)
        assert often.velocity == pytest.approx(seldom.velocity, rel=0.0, abs=100.0 * near)
        assert often.torque == pytest.approx(seldom.torque, rel=1e-12)


def test_goals_are_taken_over_at_the_ticks_of_the_loop() -> None:
    start_ns = 3 * MS + 123_456
    mechanism = Mechanism(servo(current_period=0.5e-3, delay=0.1e-3), start_ns)
    mechanism.command(1.0, start_ns + 200_000)
    mechanism.command(2.0, start_ns + 300_000)
    mechanism.advance(start_ns + 599_999)
    assert mechanism.torque == 0.0
    mechanism.advance(start_ns + 600_000)
    assert mechanism.torque == 2.0


@pytest.mark.parametrize(
    ("goal", "acting"), [(0.1, 0.0), (-0.2, 0.0), (0.22, 0.0), (1.0, 0.78), (-1.0, -0.78)]
)
def test_the_dead_band_is_missing_from_the_torque(goal: float, acting: float) -> None:
    mechanism = Mechanism(servo(dead_band=0.22), 0)
    mechanism.command(goal, 0)
    assert mechanism.torque == pytest.approx(acting)


@pytest.mark.parametrize("sign", sampled([-1, 1], 2))
def test_a_servo_runs_no_faster_than_its_supply_allows(sign: int) -> None:
    mechanism = Mechanism(servo(back_emf=True), 0)
    mechanism.command(4.0 * sign, 0)
    mechanism.advance(2000 * MS)
    assert mechanism.velocity == pytest.approx(NO_LOAD * sign, rel=1e-6)
    mechanism.feed(STALL / 2.0)
    mechanism.advance(4000 * MS)
    assert mechanism.velocity == pytest.approx(NO_LOAD / 2.0 * sign, rel=1e-6)


def test_a_limp_motor_does_not_brake() -> None:
    """Torque off is no current; a goal of 0 is a current of 0 that the loop has to keep."""
    for released in (True, False):
        mechanism = Mechanism(servo(back_emf=True, current_droop=0.5), 0)
        mechanism.command(2.0, 0)
        mechanism.advance(10 * MS)
        if released:
            mechanism.release(10 * MS)
        else:
            mechanism.command(0.0, 10 * MS)
        begin = mechanism.velocity
        mechanism.advance(200 * MS)
        assert (mechanism.velocity == begin) is released
        assert mechanism.velocity > 0.0


@pytest.mark.parametrize("inertia", [1e-8, 1e-6, 1e-4, 1e-2])
@pytest.mark.parametrize("bandwidth", [0.0, 300.0])
def test_droop_only_slows_a_free_shaft_however_light(inertia: float, bandwidth: float) -> None:
    for droop in (0.05, 0.3, 1.0):
        true = servo(
            inertia=inertia, back_emf=True, current_droop=droop, current_bandwidth=bandwidth
        )
        mechanism = Mechanism(true, 0, velocity=4.0)
        mechanism.command(0.0, 0)
        before = 4.0
        for k in range(1, 51):
            mechanism.advance(k * MS)
            assert 0.0 <= mechanism.velocity <= before < 5.0
            before = mechanism.velocity
