"""Walls on servos with a load move in arrays, tick by tick, as each simulated servo alone."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from haptic_wall.controller.experiments.maps import lanes, many_walls
from haptic_wall.controller.experiments.maps.bounce import returned
from haptic_wall.controller.experiments.maps.many_walls import Loops
from haptic_wall.controller.experiments.maps.maps import MapSettings, critical_map
from haptic_wall.controller.experiments.maps.turning import growth
from haptic_wall.controller.experiments.maps.walls import Walls, blocks
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory import flexible_boundary
from haptic_wall.controller.theory.chain import two_masses
from haptic_wall.controller.theory.chain_contact import returned as chain_returned
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.plant.current_loops import CurrentLoopParameters
from haptic_wall.hw.plant.many_two_masses import ManyTwoMasses, Transmissions
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.settings import TrueServo
from tests.cases import sampled

PERIOD, PERIOD_NS = 1e-3, 1_000_000
STATED = 1e-7
"""Bound of the error of a single servo with friction and a load, which the page on the plant states
[rad]: an array looks for events at other instants"""
ROUNDING = 1e-11
"""Its bound without friction [rad]"""
COMPILED = 1e-9
"""The compiled loop solves for its events one by one [rad, rad/s, 1]"""
STATED_RATIO = 2e-3
"""The energy is looked at once a period: vibration and friction lose some of it meanwhile"""
LOADED = (
    *("servo.load_inertia=0.003", "servo.transmission_stiffness=200"),
    *("servo.transmission_damping=0.03", "servo.torque_step=0"),
)


def drawn(seed: int, count: int, *, rough: bool) -> list[tuple[TrueServo, float, float]]:
    """Draw servos with a load, and stiffness and damping of a wall for each.

    They are alike in what one block demands: friction, counts, and whether delays are whole.
    """
    random = np.random.default_rng(seed)
    counts, lagging, limited = (bool(seed & bit) for bit in (1, 2, 4))
    found = []
    for _ in range(count):
        inertia = 10 ** random.uniform(-3.0, -1.5)
        load = inertia * 10 ** random.uniform(-1.3, 0.5)
        moving = inertia * load / (inertia + load)
        rate = math.tau * 10 ** random.uniform(0.9, 2.3)
        servo = TrueServo(
            inertia=inertia,
            damping=inertia * random.uniform(0.5, 4.0),
            coulomb=inertia * random.uniform(0.5, 8.0) if rough else 0.0,
            # Where an event is a nanosecond off, a reading near the edge of a count is another one.
            counts_per_rev=4096 if counts and not rough else 0,
            delay=1e-3 * float(random.integers(0, 4)) + 1e-6 * lagging * random.integers(1, 999),
            torque_limit=50.0 * inertia if limited else math.inf,
            load_inertia=load,
            transmission_stiffness=moving * rate**2,
            transmission_damping=2.0 * random.uniform(0.02, 0.3) * moving * rate,
            encoder="motor" if random.random() < 0.5 else "output",
            position=random.uniform(0.02, 0.3),
        )
        limit = float(
            flexible_boundary(
                servo.inertia,
                servo.damping,
                servo.load_inertia,
                servo.transmission_stiffness,
                servo.transmission_damping,
                0.0,
                PERIOD,
                servo.delay,
                encoder=servo.encoder,
            ).stiffness
        )
        found.append((servo, random.uniform(0.2, 0.9) * limit, 0.5 * servo.damping))
    return found


def states(loops: Loops) -> list[FloatArray]:
    assert isinstance(loops.bodies, ManyTwoMasses)
    return [loops.bodies.state, loops.bodies.position, loops.bodies.velocity, loops.measured]


def as_walls(given: list[tuple[TrueServo, float, float]], *, one_sided: bool = False) -> Walls:
    servos = [servo for servo, _, _ in given]
    one = np.ones(len(servos))
    delay_ns = np.array([round(servo.delay * 1e9) for servo in servos])

    def each(name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.array([getattr(servo, name) for servo in servos], dtype=np.float64)

    return Walls(
        inertia=each("inertia"),
        damping=each("damping"),
        coulomb=each("coulomb"),
        counts_per_radian=each("counts_per_rev") / math.tau,
        backlash=0.0 * one,
        torque_limit=each("torque_limit"),
        torque_step=0.0 * one,
        stiffness=np.array([stiffness for _, stiffness, _ in given]),
        virtual_damping=np.array([damping for _, _, damping in given]),
        period=PERIOD * one,
        whole=delay_ns // PERIOD_NS,
        lag=1e-9 * (delay_ns % PERIOD_NS),
        rest=1e-9 * (PERIOD_NS - delay_ns % PERIOD_NS),
        velocity_samples=np.ones(one.size, dtype=np.int64),
        one_sided=np.full(one.size, one_sided),
        transmission=Transmissions(
            load_inertia=each("load_inertia"),
            stiffness=each("transmission_stiffness"),
            damping=each("transmission_damping"),
            on_motor=np.array([servo.encoder == "motor" for servo in servos]),
        ),
    )


def alone(servo: TrueServo, stiffness: float, damping: float, periods: int) -> list[float]:
    """Return the readings of one simulated servo."""
    mechanism, before = Mechanism(servo, 0), math.nan
    readings = []
    for k in range(periods):
        mechanism.advance(k * PERIOD_NS)
        position = mechanism.measured_position()
        speed = (position - before) / PERIOD if k else 0.0
        before = position
        readings.append(position)
        mechanism.command(-stiffness * position - damping * speed, k * PERIOD_NS)
    return readings


@pytest.mark.parametrize("rough", [False, True], ids=["linear", "friction"])
@pytest.mark.parametrize("seed", sampled(range(8), 8))
def test_random_walls_move_as_each_servo_alone(seed: int, rough: bool, thorough: bool) -> None:
    periods = 600 if thorough else 150
    given = drawn(seed, 20 if thorough else 4, rough=rough)
    walls = as_walls(given)
    starts = np.array([servo.position for servo, _, _ in given])
    found, rests = np.empty((periods, walls.size)), 0
    for index in blocks(walls):
        loops = Loops(walls.take(index), starts[index])
        for k in range(periods):
            loops.run(1)
            found[k, index] = loops.measured
            rests += int(np.count_nonzero(loops.bodies.motor_velocity == 0.0))
    expected = np.array([alone(*one, periods) for one in given]).T
    assert np.max(np.abs(found - expected)) < (STATED if rough else ROUNDING)
    assert np.ptp(found, axis=0).min() > 1e-3
    if rough:
        assert rests > 0, "no motor ever came to rest"


@pytest.mark.parametrize("drive", [False, True], ids=["", "current-loop"])
@pytest.mark.parametrize("seed", sampled(range(8), 8))
def test_compiled_walls_move_as_the_arrays_do(seed: int, drive: bool, thorough: bool) -> None:
    pytest.importorskip("numba", reason="pip install 'haptic-wall[fast]'")
    given = drawn(seed, 200 if thorough else 20, rough=bool(seed % 3))
    walls = as_walls(given)
    if drive:
        one = np.ones(walls.size)
        stall = 50.0 * walls.inertia
        loops = CurrentLoopParameters(
            150.0 * one, 0.1 * walls.inertia, stall / 5.0, stall, 0.1 * one
        )
        walls = replace(walls, current_loop=loops)
    starts = np.array([servo.position for servo, _, _ in given])
    for index in blocks(walls):
        some = walls.take(index)
        expected, found = (Loops(some, starts[index], compile_=way) for way in (False, True))
        assert found.lanes is not None
        for part in (1, 200, 8):  # one period runs in arrays: each takes over from the other
            expected.run(part)
            found.run(part)
            for one, other in zip(states(found), states(expected), strict=True):
                np.testing.assert_allclose(one, other, rtol=0.0, atol=COMPILED)


@pytest.mark.whole
@pytest.mark.parametrize("one_sided", [False, True])
def test_growths_and_returned_speeds_are_those_of_the_arrays(
    monkeypatch: pytest.MonkeyPatch, one_sided: bool, thorough: bool
) -> None:
    pytest.importorskip("numba", reason="pip install 'haptic-wall[fast]'")
    walls = as_walls(drawn(5, 20 if thorough else 3, rough=True), one_sided=one_sided)
    kick = np.full(walls.size, 0.05)
    asked = returned if one_sided else partial(growth, cycles=3.0)
    answer = asked(walls, kick)
    monkeypatch.setattr(many_walls, "compiled", lambda: None)
    np.testing.assert_allclose(answer, asked(walls, kick), rtol=0.0, atol=COMPILED)


@pytest.mark.whole
def test_the_source_of_the_compiled_loop_does_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    given = drawn(3, 3, rough=True)
    walls, starts = as_walls(given), np.array([servo.position for servo, _, _ in given])
    monkeypatch.setattr(many_walls, "compiled", lambda: lanes.run)
    for index in blocks(walls):
        some = walls.take(index)
        expected, found = (Loops(some, starts[index], compile_=way) for way in (False, True))
        expected.run(40)
        found.run(40)
        for one, other in zip(states(found), states(expected), strict=True):
            np.testing.assert_allclose(one, other, rtol=0.0, atol=COMPILED)


def test_the_simulated_limit_without_friction_is_the_exact_one() -> None:
    sets = ("servo.coulomb=0", "servo.counts_per_rev=0", "wall.side=both", *LOADED)
    for side in ("output", "motor"):
        config = load_config("simulated", (*sets, f"servo.encoder={side}")).config
        with ThreadPoolExecutor(1) as here:
            found = critical_map(MapSettings.of(config), [0.0, 0.05], [1], [0.03], executor=here)
        np.testing.assert_allclose(found.stiffness[0, :, 0], found.exact[0], rtol=1e-4)


def test_contacts_return_what_the_theory_says() -> None:
    given = drawn(0, 4, rough=False)
    phases = np.linspace(1e-9, 1.0, 65)
    found = returned(as_walls(given, one_sided=True), np.full(4, 0.03))
    for (servo, stiffness, damping), one in zip(given, found, strict=True):
        chain, _ = two_masses(
            servo.inertia,
            servo.damping,
            servo.load_inertia,
            servo.transmission_stiffness,
            servo.transmission_damping,
            encoder=servo.encoder,
        )
        every = chain.take(np.zeros(phases.size, dtype=np.int64))
        walls = (np.full(phases.size, stiffness), np.full(phases.size, damping))
        ratio = chain_returned(every, PERIOD, servo.delay, *walls, phases, 1, 10_000)
        assert math.exp(one) == pytest.approx(float(np.max(ratio)), abs=STATED_RATIO)


def test_a_load_is_refused_beside_backlash_and_effects() -> None:
    walls = as_walls(drawn(0, 2, rough=False))
    with pytest.raises(ValueError, match="give none of them"):
        Loops(replace(walls, backlash=np.full(2, 0.01)), np.zeros(2))


def test_values_out_of_range_are_refused() -> None:
    walls = as_walls(drawn(0, 2, rough=False))
    assert walls.transmission is not None
    bad = replace(walls.transmission, stiffness=np.zeros(2))
    one = np.ones(2)
    with pytest.raises(ValueError, match="transmission_stiffness is 0"):
        ManyTwoMasses(one, one, one, bad, one, one)
