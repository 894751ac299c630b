"""A servo that senses its supply's current: the wall that was asked for is the wall that acts.

The driver on the emulated bus in memory. What ought to act is computed here from the balance of
power and the published figures of an XL330-M288, not by the law under test.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.dynamixel.torque_law import TorqueLaw, torque_law
from haptic_wall.hw.errors import UnfitServoError
from haptic_wall.hw.truth import TrueServo
from tests.hw.dynamixel.bench import Bench

SMALL = "XL330-M288"
VOLTS, STALL, TORQUE, NO_LOAD = 5.0, 1.47, 0.52, 103 * 2 * math.pi / 60
"""Published: [V], [A], [N·m], [rad/s]"""
CONSTANT, RESISTANCE, BACK_EMF = TORQUE / STALL, VOLTS / STALL, VOLTS / NO_LOAD
SMALLEST = TORQUE * math.sqrt(1 / 1470)
"""[N·m] for 1 mA"""
INERTIA = 0.0018142
STIFFNESS, REST = 0.3, 1.0
Send = Callable[[float], float]


def bench(true: TrueServo, **settings: object) -> Bench:
    made = Bench(true, model=SMALL)
    made.settings = replace(made.settings, model=SMALL, probe_torque=0.0, **settings)  # type: ignore[arg-type]
    made.servo = type(made.servo)(made.settings, made.line)
    made.servo.start()
    return made


def in_proportion(torque: float) -> float:
    """A torque that makes the driver send what a law in proportion would send."""
    milliamperes = round(torque / CONSTANT * 1e3)
    return math.copysign(SMALLEST * math.sqrt(abs(milliamperes)), milliamperes)


def as_it_is(torque: float) -> float:
    return torque


def held_stiffness(displacement: float, send: Send) -> tuple[float, float, float]:
    """Torque asked of a spring, the torque returned and that which acts; a hand holds the shaft."""
    held = TrueServo(inertia=INERTIA, coulomb=50.0, position=REST + displacement)
    rig = bench(held)
    for _ in range(60):  # PWM Slope takes 18 ms to full scale
        begun = rig.clock.now_ns()
        rig.servo.request()
        position = rig.servo.collect(begun + 900_000).position
        asked = -STIFFNESS * (position - REST)
        returned = rig.servo.write(send(asked))
        rig.clock.wait_until(begun + 1_000_000)
    return asked, returned, rig.state.torque


@pytest.mark.parametrize("displacement", [-1.5, -0.3, -0.1, 0.06, 0.2, 0.7, 1.6])
def test_a_held_shaft_feels_the_stiffness_asked_for(displacement: float) -> None:
    """Never more; less by no more than one step of the goal, dτ = step² / 2τ, there."""
    asked, returned, acting = held_stiffness(displacement, as_it_is)
    assert acting == pytest.approx(returned, rel=1e-6)
    short = abs(asked) - abs(acting)
    assert math.copysign(1.0, acting) == math.copysign(1.0, asked)
    assert -1e-9 <= short <= SMALLEST**2 / abs(asked)


def test_torques_below_the_first_step_are_none() -> None:
    rig = bench(TrueServo(inertia=INERTIA, coulomb=50.0))
    assert rig.servo.facts.torque_step == pytest.approx(SMALLEST)
    assert rig.servo.write(0.99 * SMALLEST) == 0.0
    assert rig.servo.write(-0.99 * SMALLEST) == 0.0
    assert rig.servo.write(1.01 * SMALLEST) == pytest.approx(SMALLEST)


@pytest.mark.parametrize("model", ["XM430-W350", SMALL])
def test_a_limit_beyond_all_measure_is_no_limit(model: str) -> None:
    law = torque_law(MODELS[model], 1.0, VOLTS)
    assert law.within(1.7e308) > MODELS[model].current_limit


def test_a_limit_below_the_smallest_torque_is_refused() -> None:
    with pytest.raises(UnfitServoError, match=r"smallest torque of the XL330-M288 is 0\.014 N·m"):
        bench(TrueServo(inertia=INERTIA), torque_limit=0.01)


def test_a_limit_that_only_the_supply_found_puts_out_of_reach_is_refused() -> None:
    rig = bench(TrueServo(inertia=INERTIA), torque_limit=0.0140)
    rig.servo.stop()
    rig.truth.set_supply(6.0, rig.clock.now_ns())
    with pytest.raises(UnfitServoError, match=r"0\.015 N·m at this supply"):
        rig.servo.start()
    assert rig.truth.memory["torque_enable"] == 0


# In motion


def acceleration(position: float, speed: float) -> float:
    """Of a spring whose torque at rest is sent in whole mA of supply, by U i_s = R i² + k_e w i."""
    wanted = STIFFNESS * (REST - position) / CONSTANT
    supply = math.floor(1e3 * RESISTANCE * wanted**2 / VOLTS) * 1e-3
    if supply == 0.0:
        return 0.0
    sign = math.copysign(1.0, wanted)
    emf = sign * BACK_EMF * speed
    current = (math.sqrt(emf**2 + 4.0 * RESISTANCE * VOLTS * supply) - emf) / (2.0 * RESISTANCE)
    return CONSTANT * sign * current / INERTIA


def theory(start: float, milliseconds: int) -> list[float]:
    """Positions at each millisecond of a shaft let go at rest, by the midpoint rule at 10 µs."""
    position, speed, found = start, 0.0, []
    step = 1e-5
    for _ in range(milliseconds):
        found.append(position)
        for _ in range(100):
            half = speed + 0.5 * step * acceleration(position, speed)
            middle = position + 0.5 * step * speed
            position += step * half
            speed += step * acceleration(middle, half)
    return found


def let_go(start: float, milliseconds: int, send: Send) -> list[float]:
    """The truth, each millisecond; with PWM Slope out of the way, which is not what is tried."""
    rig = bench(TrueServo(inertia=INERTIA, position=start))
    rig.truth.memory["pwm_slope"] = 0
    position, found = start, []
    for _ in range(milliseconds):
        found.append(rig.state.position)
        position = rig.cycle(send(STIFFNESS * (REST - position)))
    return found


def arrival(positions: list[float]) -> int:
    """When a tenth of the way remains [ms]."""
    return next(
        n for n, x in enumerate(positions) if abs(x - REST) < 0.1 * abs(positions[0] - REST)
    )


def test_a_shaft_let_go_swings_as_theory_has_it() -> None:
    """The spring asked for, and the damping that back-EMF adds, which nobody asked for.

    The sample, the bus and the servo's own period delay it by up to 2 ms; the shaft is never
    faster than a swing of the undamped spring, A w, and a shift in time by 2 ms is 2 ms of that.
    """
    away, milliseconds = 0.8, 400
    fastest = away * math.sqrt(STIFFNESS / INERTIA)
    expected = theory(REST + away, milliseconds)
    found = let_go(REST + away, milliseconds, as_it_is)
    assert arrival(found) == pytest.approx(arrival(expected), abs=3)
    worst = max(abs(a - b) for a, b in zip(found, expected, strict=True))
    assert worst < 2e-3 * fastest
    # The frequency would tell a law in proportion, and so would every position.
    wrong = let_go(REST + away, milliseconds, in_proportion)
    assert arrival(wrong) < 0.85 * arrival(expected)
    assert max(abs(a - b) for a, b in zip(wrong, expected, strict=True)) > 20e-3 * fastest


def test_motion_loses_energy_to_back_emf_and_gains_none() -> None:
    """Each swing is smaller than the last, though the goals are those of a spring alone."""
    found = let_go(REST + 0.8, 1500, as_it_is)
    turns = [
        abs(b - REST)
        for a, b, c in zip(found, found[1:], found[2:], strict=False)
        if (b - a) * (c - b) < 0
    ]
    assert len(turns) > 2
    assert all(later < earlier for earlier, later in itertools.pairwise([0.8, *turns]))


# The law itself


@given(
    torque=st.floats(-0.9, 0.9),
    volts=st.floats(3.7, 6.0),
    name=st.sampled_from(["XL330-M077", SMALL, "XC330-T288"]),
)
def test_no_more_is_sent_than_asked_and_the_next_goal_would_be_more(
    torque: float, volts: float, name: str
) -> None:
    law = torque_law(MODELS[name], 0.35, volts)
    goal = law.goal(torque)
    assert abs(law.torque(goal)) <= abs(torque) * (1 + 1e-9) + 1e-12
    assert abs(torque) < law.torque(abs(goal) + 1)
    assert law.goal(-torque) == -goal
    assert law.goal(law.torque(goal)) == goal


@given(goal=st.integers(1, 2352), volts=st.floats(3.7, 6.0))
def test_the_step_is_the_largest_between_neighbours(goal: int, volts: float) -> None:
    law = torque_law(MODELS[SMALL], CONSTANT, volts)
    assert law.torque(goal) - law.torque(goal - 1) <= law.step * (1 + 1e-12)


def test_a_weaker_supply_gives_less_torque_for_the_same_current() -> None:
    """Power in is power lost: U i_s = R i²."""
    full, weak = (torque_law(MODELS[SMALL], CONSTANT, volts) for volts in (5.0, 4.0))
    assert weak.torque(500) / full.torque(500) == pytest.approx(math.sqrt(4 / 5))


def test_if_it_senses_its_motor_after_all_no_more_acts_than_asked() -> None:
    """Up to stall torque the law sends less than a law in proportion would."""
    law = torque_law(MODELS[SMALL], CONSTANT, VOLTS)
    for milli in range(1, 521):
        torque = milli * 1e-3
        assert law.goal(torque) * 1e-3 * CONSTANT <= torque


def goals(law: TorqueLaw, torques: list[float]) -> list[int]:
    return [law.goal(torque) for torque in torques]


def test_other_models_are_in_proportion_to_the_nearest_unit() -> None:
    constant = 4.1 / 2.3
    law = torque_law(MODELS["XM430-W350"], constant, 7.0)  # whatever its supply
    step = constant * 2.69 * 1e-3
    assert law.step == step  # to the bit
    torques = [0.37 * step, 0.62 * step, -7.4 * step, 3.0, -4.1]
    assert goals(law, torques) == [round(torque / step) for torque in torques]
    assert law.torque(77) == 77 * step


def test_the_start_reads_the_supply_it_counts_with() -> None:
    rig = bench(TrueServo(inertia=INERTIA, coulomb=50.0))
    rig.servo.stop()
    rig.truth.set_supply(4.2, rig.clock.now_ns())
    rig.servo.start()
    assert rig.servo.facts.torque_step == pytest.approx(SMALLEST * math.sqrt(4.2 / 5))
    returned = rig.servo.write(0.2)
    rig.wait(0.03)
    assert rig.state.torque == pytest.approx(returned, rel=1e-6)
