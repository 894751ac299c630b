"""The compiled loop does what the arrays do, to the last bit; so does its source, uncompiled."""

from __future__ import annotations

import fcntl
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.experiments.maps import lane_laws, lane_rest, lanes, many_walls
from haptic_wall.controller.experiments.maps.bounce import returned
from haptic_wall.controller.experiments.maps.compiled import (
    Run,
    compiled,
    compiled_once,
    fingerprint,
)
from haptic_wall.controller.experiments.maps.many_walls import Loops
from haptic_wall.controller.experiments.maps.onset import simulated_critical_stiffness
from haptic_wall.controller.experiments.maps.tables import Table
from haptic_wall.controller.experiments.maps.turning import growth
from haptic_wall.controller.experiments.maps.walls import Walls, blocks, split_delay
from haptic_wall.controller.laws.friction import Friction
from haptic_wall.controller.laws.own import Instants
from haptic_wall.controller.laws.profile import Profile
from haptic_wall.controller.laws.shape import Memoryless, Shape
from haptic_wall.controller.laws.shaped import ShapedLaw
from haptic_wall.controller.laws.stops import Stops
from haptic_wall.controller.laws.texture import Texture
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from haptic_wall.hw.plant.current_loops import CurrentLoopParameters
from haptic_wall.hw.plant.many_two_masses import Transmissions
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.settings import TrueServo
from tests.cases import sampled

PERIOD = 1e-3
SOME = 7
CASES = range(24)


@pytest.fixture(params=["compiled", "uncompiled"])
def run(request: pytest.FixtureRequest) -> Run:
    if request.param == "uncompiled":
        return lanes.run
    pytest.importorskip("numba", reason="pip install 'haptic-wall[fast]'")
    found = compiled()
    assert found is not None
    return found


@pytest.fixture
def arrays(monkeypatch: pytest.MonkeyPatch) -> Iterator[pytest.MonkeyPatch]:
    """Nothing runs in lanes, until a test says so."""
    monkeypatch.setattr(many_walls, "compiled", lambda: None)
    with np.errstate(all="ignore"):  # plain Python floats of NumPy warn, compiled ones do not
        yield monkeypatch


def drawn(seed: int, count: int = 150) -> Walls:
    """Walls that differ in everything but what is alike in a block."""
    random = np.random.default_rng(seed)
    some = random.random(8) < 0.5
    inertia = 10 ** random.uniform(-3.0, -1.0, count)
    damping = inertia * random.uniform(0.0, 4.0, count)
    if seed % 6 == 0:
        damping *= 1000.0  # loses its speed within a step
    delay = np.sort(random.integers(0, 7, count)) + (0.001 + 0.99 * random.random(count)) * some[0]
    samples = int(random.integers(1, 5)) if some[1] else 1
    ceiling = max_virtual_damping(inertia, damping, PERIOD, delay * PERIOD, samples)
    virtual = random.uniform(0.0, 1.1, count) * ceiling
    limit = critical_stiffness(inertia, damping, virtual, PERIOD, delay * PERIOD, samples)
    whole, lag, rest = split_delay(delay * PERIOD, np.full(count, PERIOD))
    one = np.ones(count)
    return Walls(
        inertia=inertia,
        damping=damping,
        coulomb=random.uniform(0.1, 3.0, count) * inertia * some[2],
        counts_per_radian=random.choice([4096, 500], count) / math.tau * some[3],
        backlash=random.uniform(1e-4, 1e-2, count) * some[4],
        torque_limit=50.0 * inertia if some[5] else math.inf * one,
        torque_step=0.3 * inertia * some[6],
        stiffness=random.uniform(0.1, 1.5, count) * np.maximum(limit, 0.1),
        virtual_damping=virtual,
        period=PERIOD * one,
        whole=whole,
        lag=lag,
        rest=rest,
        velocity_samples=np.full(count, samples),
        one_sided=np.full(count, bool(some[7])),
    )


def states(loops: Loops) -> list[Any]:
    return [
        loops.bodies.position,
        loops.bodies.velocity,
        loops.measured,
        loops.torque,
        loops._followed if loops._play else loops.bodies.position,
    ]


@pytest.mark.parametrize("seed", sampled(CASES, 24))
def test_random_walls_move_as_the_arrays_do(
    run: Run, arrays: pytest.MonkeyPatch, seed: int
) -> None:
    walls = drawn(seed, 150 if run is not lanes.run else SOME)
    periods = 300 if run is not lanes.run else 12
    if run is lanes.run and seed % 3:
        return  # it is slow, and the same
    random = np.random.default_rng(seed)
    start, velocity = random.normal(0.0, 0.1, (2, walls.size))
    expected = Loops(walls, start, velocity)
    arrays.setattr(many_walls, "compiled", lambda: run)
    found = Loops(walls, start, velocity)
    assert expected.lanes is None
    assert found.lanes is not None
    for part in (1, periods, 3, 8):  # short parts run in arrays, and take over from each other
        expected.run(part)
        found.run(part)
        for one, other in zip(states(found), states(expected), strict=True):
            np.testing.assert_array_equal(one, other)
    assert np.ptp(found.bodies.position) > 0.0


@pytest.mark.parametrize("seed", sampled([3, 0, 1, 5, 2, 4], 6))
def test_servos_with_a_current_loop_move_as_in_the_arrays(
    run: Run, arrays: pytest.MonkeyPatch, seed: int
) -> None:
    few = run is lanes.run
    walls = drawn(seed, 3 if few else 150)
    random, one = np.random.default_rng(seed), np.ones(walls.size)
    back_emf, dead, lagging = (bool(seed & bit) for bit in (1, 2, 4))
    stall = 40.0 * walls.inertia
    parameters = CurrentLoopParameters(
        bandwidth=random.uniform(50.0, 300.0, walls.size) * (lagging or not back_emf),
        dead_band=0.2 * walls.inertia * dead,
        back_emf=stall / 5.0 * back_emf,
        stall_torque=stall,
        droop=0.1 * one,
    )
    walls = replace(walls, current_loop=parameters)
    start, velocity = random.normal(0.0, 0.1, (2, walls.size))
    expected = Loops(walls, start, velocity)
    arrays.setattr(many_walls, "compiled", lambda: run)
    found = Loops(walls, start, velocity)
    assert found.lanes is not None
    for part in (1, 8 if few else 200, 3):
        expected.run(part)
        found.run(part)
        for one, other in zip(states(found), states(expected), strict=True):
            np.testing.assert_array_equal(one, other)


LAWS: dict[str, Shape] = {
    "profile": Profile([-0.2, -0.05, 0.1, 0.3], [0.4, 0.1, 0.0, -2.0]),
    "stops": Stops(-0.05, 0.08),
}


class OneWay(Memoryless):
    """Acts on a shaft that turns down."""

    stiffness: float | None = None
    highest_slope, lowest_slope = 1.0, -1.0

    def elongation(self, away: float, speed: float, stiffness: float) -> float:  # noqa: ARG002
        return min(0.1 * away, 0.0) if speed < 0.0 else 0.0

    def potential(self, away: float) -> float:  # noqa: ARG002
        return 0.0


RAMPS = [Profile([-0.1, 0.1], [most, -most]) for most in (1.0, 2.0)]
MORE = [Friction(0.1), Friction(10.0), Texture(0.02, PERIOD), OneWay(), Instants(RAMPS)]


@pytest.mark.parametrize("shape", MORE)
def test_a_law_that_depends_on_more_than_the_position_has_no_table(shape: Shape) -> None:
    with pytest.raises(ValueError, match="more than the position"):
        Table.of(shape, np.linspace(-0.1, 0.1, 5))


@pytest.mark.parametrize(
    ("positions", "elongations"),
    [([], []), ([0.0], [0.1]), ([0.0, 0.0], [0.1, 0.2]), ([0.0, math.nan], [0.0, 1.0]),
     ([0.1, 0.0], [0.0, 1.0]), ([0.0, 0.1], [0.0])],
)  # fmt: skip
def test_a_table_that_cannot_be_searched_is_refused(
    positions: list[float], elongations: list[float]
) -> None:
    with pytest.raises(ValueError, match="two or more rising positions"):
        Table(np.array(positions), np.array(elongations))


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("loaded", [False, True], ids=["rigid", "load"])
def test_laws_from_a_table_move_as_each_alone_and_compiled(
    run: Run, arrays: pytest.MonkeyPatch, name: str, loaded: bool
) -> None:
    random, count = np.random.default_rng(8), 3 if run is lanes.run else 40
    servos = [
        TrueServo(
            inertia=0.012,
            damping=0.02,
            counts_per_rev=4096,
            position=float(x),
            load_inertia=0.004 if loaded else 0.0,
            transmission_stiffness=300.0 if loaded else 0.0,
            transmission_damping=0.05 if loaded else 0.0,
        )
        for x in random.uniform(-0.3, 0.3, count)
    ]
    law: Shape = LAWS[name]
    one = np.ones(count)
    loads = Transmissions(0.004 * one, 300.0 * one, 0.05 * one, one < 0.0)
    walls = replace(
        drawn(0, count),
        inertia=0.012 * one,
        damping=0.02 * one,
        coulomb=0.0 * one,
        counts_per_radian=4096 / math.tau * one,
        backlash=0.0 * one,
        torque_limit=4.1 * one,
        torque_step=0.0 * one,
        stiffness=8.0 * one,
        virtual_damping=0.02 * one,
        whole=np.zeros(count, dtype=np.int64),
        lag=0.0 * one,
        rest=PERIOD * one,
        velocity_samples=np.ones(count, dtype=np.int64),
        law=Table.of(law, np.array([-0.2, -0.05, 0.08, 0.1, 0.3])),
        transmission=loads if loaded else None,
    )
    if name == "stops":
        walls = replace(walls, law=Table.of(law, np.array([-9.0, -0.05, 0.08, 9.0])))
    starts = np.array([servo.position for servo in servos])
    periods = 12 if run is lanes.run else 150
    expected = Loops(walls, starts)
    expected.run(periods)
    for i, servo in enumerate(servos[:3]):
        rendered, before = ShapedLaw(name, law, 0.0), math.nan
        rendered.stiffness, rendered.damping = 8.0, 0.02
        mechanism = Mechanism(servo, 0)
        for k in range(periods):
            mechanism.advance(k * 1_000_000)
            position = mechanism.measured_position()
            speed = (position - before) / PERIOD if k else 0.0
            before = position
            mechanism.command(rendered.torque(position, speed), k * 1_000_000)
        mechanism.advance(periods * 1_000_000)
        assert expected.bodies.position[i] == pytest.approx(mechanism.position, abs=1e-9)
    arrays.setattr(many_walls, "compiled", lambda: run)
    found = Loops(walls, starts)
    assert found.lanes is not None
    found.run(periods)
    np.testing.assert_array_equal(found.bodies.position, expected.bodies.position)
    np.testing.assert_array_equal(found.torque, expected.torque)
    assert np.ptp(found.torque) > 0.0


def drawn_law(seed: int) -> Table:
    """A table of straight pieces, narrower than the walls' motion; every other one in contact."""
    random = np.random.default_rng(seed)
    rows = int(random.integers(2, 40))
    positions = np.sort(random.normal(0.0, 0.1, rows))
    slopes = random.uniform(-1.0, 1.0, rows - 1)
    elongations = np.cumsum([random.normal(0.0, 0.1), *(slopes * np.diff(positions))])
    if seed % 2:  # as stops: there is a range without torque
        elongations[rows // 3 : rows // 2 + 1] = 0.0
    return Table(positions, elongations, seed % 2 == 0)


@pytest.mark.parametrize("seed", sampled(range(12), 4))
def test_random_laws_move_as_in_the_arrays(run: Run, arrays: pytest.MonkeyPatch, seed: int) -> None:
    few = run is lanes.run
    walls = replace(drawn(seed, SOME if few else 150), law=drawn_law(seed))
    start, velocity = np.random.default_rng(seed).normal(0.0, [[0.1], [5.0]], (2, walls.size))
    expected = Loops(walls, start, velocity)
    arrays.setattr(many_walls, "compiled", lambda: run)
    found = Loops(walls, start, velocity)
    assert found.lanes is not None
    for part in (1, 9 if few else 300, 3, 8):
        expected.run(part)
        found.run(part)
        for one, other in zip(states(found), states(expected), strict=True):
            np.testing.assert_array_equal(one, other)
    assert np.ptp(found.torque) > 0.0


@pytest.mark.parametrize("rows", [2, 3, 20])
def test_the_piece_of_a_table_is_found_from_every_other(rows: int) -> None:
    random = np.random.default_rng(rows)
    table = np.sort(random.normal(0.0, 1.0, (2, rows)))
    rising = table[0]
    between = 0.5 * (rising[1:] + rising[:-1])
    places = np.concatenate([rising, between, [-math.inf, -9.0, 9.0, math.inf]])
    expected = np.clip(np.searchsorted(rising, places, side="right") - 1, 0, rows - 2)
    for near in range(rows - 1):
        assert [lane_laws.piece(table, near, x) for x in places] == expected.tolist()
        assert lane_laws.piece(table, near, math.nan) in range(rows - 1)


def test_changed_sources_have_another_key(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    before = fingerprint()
    changed = tmp_path / "lane_rest.py"
    changed.write_text(Path(str(lane_rest.__file__)).read_text() + "# more")
    monkeypatch.setattr(lane_rest, "__file__", str(changed))
    assert fingerprint() != before


def test_one_process_compiles_and_the_others_wait_for_it() -> None:
    def alone(*_given: object) -> int:
        with Path(str(lanes.__file__)).open() as sources:
            try:
                fcntl.flock(sources, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return 1
        return 0

    run = compiled_once(alone)
    assert [run(), run()] == [1, 0], "while it compiles, and afterwards"


def test_a_process_that_was_stopped_while_it_compiled_is_not_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    name = "haptic_wall.controller.experiments.maps.compiled.PATIENCE_S"
    monkeypatch.setattr(name, 0.1)
    with Path(str(lanes.__file__)).open() as sources:
        fcntl.flock(sources, fcntl.LOCK_EX)
        assert compiled_once(lambda: 7)() == 7


def test_the_draws_have_every_trait_and_its_absence() -> None:
    every = [drawn(seed, SOME) for seed in CASES]
    for trait in ("lag", "coulomb", "counts_per_radian", "backlash", "torque_step", "one_sided"):
        assert {bool((getattr(walls, trait) > 0).any()) for walls in every} == {False, True}
    assert {int(walls.velocity_samples[0]) for walls in every} >= {1, 2}
    assert {bool(np.isfinite(walls.torque_limit[0])) for walls in every} == {False, True}


@pytest.mark.whole
def test_an_operator_pushes_as_in_the_arrays(run: Run, arrays: pytest.MonkeyPatch) -> None:
    walls = drawn(3, SOME)
    hands = np.random.default_rng(3).normal(0.0, 0.1, (40, SOME)) * walls.inertia
    expected = Loops(walls, np.zeros(SOME))
    course = expected.driven(hands)
    expected.hand = hands[0]
    expected.run(30)
    arrays.setattr(many_walls, "compiled", lambda: run)
    found = Loops(walls, np.zeros(SOME))
    np.testing.assert_array_equal(found.driven(hands), course)
    found.hand = hands[0]
    found.run(30)
    np.testing.assert_array_equal(found.bodies.position, expected.bodies.position)


@pytest.mark.parametrize("seed", sampled([9, 5, 1, 13, 17, 21], 3))
def test_growth_and_returned_speeds_are_those_of_the_arrays(
    arrays: pytest.MonkeyPatch, seed: int
) -> None:
    pytest.importorskip("numba", reason="pip install 'haptic-wall[fast]'")
    walls = drawn(seed, 20)
    kick = 10 ** np.random.default_rng(seed).uniform(-3.0, -0.5, walls.size)

    def asked() -> Any:
        return returned(walls, kick) if walls.one_sided[0] else growth(walls, kick, 3.0)

    expected = asked()
    arrays.setattr(many_walls, "compiled", compiled)
    np.testing.assert_array_equal(asked(), expected)
    assert len(list(blocks(walls))) >= 1


@pytest.mark.whole
@pytest.mark.parametrize("one_sided", sampled([True, False], 2))
def test_critical_stiffnesses_are_those_of_the_arrays(
    arrays: pytest.MonkeyPatch, one_sided: bool
) -> None:
    pytest.importorskip("numba", reason="pip install 'haptic-wall[fast]'")

    def asked() -> Any:
        return simulated_critical_stiffness(
            0.012,
            0.0117,
            np.array([0.0, 0.1, 0.3]),
            PERIOD,
            1.4e-3,
            coulomb=0.05,
            position_step=np.array([[0.0], [math.tau / 4096]]),
            backlash=0.002,
            torque_limit=1.0,
            one_sided=one_sided,
            kick=0.05,
            tolerance=0.01,
        )

    expected = asked()
    arrays.setattr(many_walls, "compiled", compiled)
    np.testing.assert_array_equal(asked(), expected)


def test_nothing_is_compiled_where_numba_is_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    compiled.cache_clear()
    try:
        assert compiled() is None
        assert Loops(drawn(1, SOME), np.zeros(SOME)).lanes is None
    finally:
        compiled.cache_clear()


def test_nothing_is_compiled_where_numba_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "numba", None)
    compiled.cache_clear()
    try:
        assert compiled() is None
    finally:
        compiled.cache_clear()
