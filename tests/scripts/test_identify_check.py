"""The page's figures are what identification finds now."""

import pytest

from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.truth import TrueServo
from scripts.studies.identify_check import FIRST, Bounded, effect_identified
from tests.support.real_servos import ALL, EFFECTS, KINDS, Kind, drawn_servo, truth_of
from tests.typed import not_none


@pytest.mark.thorough
def test_the_bounds_of_a_real_servo_hold_it() -> None:
    """The first of those that the page counts."""
    cases = [(kind, effect, FIRST) for kind in KINDS for effect in (*EFFECTS, ALL)]
    found = [effect_identified(case) for case in cases]
    assert [each for each in found if not isinstance(each, Bounded) or not each.held] == []


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_a_current_loop_counts_as_the_inertia_and_delay_of_its_motion(kind: Kind) -> None:
    """Long after a step of the torque T the speed is T / m (t - delay)."""
    config = drawn_servo(kind, "current loop", 7017)  # 102 Hz, the slowest of the page
    whole, _, delay = truth_of(kind, config)
    servo = config.servo
    inertia = not_none(servo.inertia)
    true = TrueServo(
        inertia=inertia,
        counts_per_rev=0,
        delay=not_none(servo.delay),
        torque_limit=kind.torque_limit,
        no_load_speed=kind.no_load_speed,
        current_bandwidth=servo.current_bandwidth,
        back_emf=True,
    )
    plant, torque = Mechanism(true, 0), 0.1 * kind.torque_limit
    plant.command(torque, 0)
    plant.advance(30_000_000)
    early = plant.velocity
    plant.advance(40_000_000)
    assert torque / whole == pytest.approx((plant.velocity - early) / 0.01, rel=1e-4)
    acts = 0.04 - plant.velocity * whole / torque + 0.5 * servo.current_period
    assert acts == pytest.approx(delay, abs=5e-6)
