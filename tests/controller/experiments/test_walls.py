"""A wall of a map moves as the simulated servo under the program's law; compiled the same."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from haptic_wall.controller.experiments.maps import search, walls
from haptic_wall.controller.experiments.maps.bounce import returned
from haptic_wall.controller.experiments.maps.compiled import compiled
from haptic_wall.controller.experiments.maps.maps import MapQuestion, critical_map
from haptic_wall.controller.experiments.maps.servo import MapSettings
from haptic_wall.controller.experiments.maps.walls import Loop, buffers, noise_of, wall_of
from haptic_wall.controller.laws.velocity import velocity_estimator
from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.laws.wall import Wall as ProgramWall
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory.boundary import chain_boundary
from haptic_wall.controller.theory.chain import two_masses
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.truth import TrueServo
from tests.support.chain_contact import returned as chain_returned
from tests.support.executors import AtOnce
from tests.support.program import call

PERIOD, PERIOD_NS = 1e-3, 1_000_000
PAST = 150
"""Periods of a comparison"""
STATED_RATIO = 2e-3
"""The energy is looked at once a period: vibration and friction lose some of it meanwhile"""


@pytest.fixture
def uncompiled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(walls, "compiled", lambda: None)


def drawn(random: np.random.Generator, kinds: set[str]) -> TrueServo:
    """Draw a servo with all that these kinds add."""
    m = 10 ** random.uniform(-3.0, -1.0)
    given: dict[str, float | str | bool] = {"counts_per_rev": 0, "torque_limit": 50.0 * m}
    if "rough" in kinds:
        given |= {"coulomb": m * random.uniform(0.5, 8.0)}
    if "backlash" in kinds:
        given |= {"backlash": random.uniform(0.001, 0.01)}
    if "effects" in kinds:
        given |= {"static_friction": 12.0 * m, "stribeck_speed": 0.5, "load_friction": 0.1}
        given |= {"gravity": 10.0 * m, "cogging": 1.0 * m}
    if "load" in kinds:
        rate, load = math.tau * 10 ** random.uniform(0.9, 2.0), m * random.uniform(0.1, 3.0)
        given |= {"load_inertia": load, "transmission_stiffness": m * rate**2}
        given |= {
            "transmission_damping": 0.1 * m * rate,
            "encoder": random.choice(["motor", "output"]),
        }
    if "drive" in kinds:
        given |= {"current_bandwidth": 150.0, "dead_band": 0.1 * m, "back_emf": True}
        given |= {"no_load_speed": 5.0, "current_droop": 0.1}
    if "encoder" in kinds:
        given |= {"counts_per_rev": 4096, "encoder_eccentricity": 0.01, "encoder_noise": 0.5}
        given |= {"noise_seed": 3}
    return TrueServo(m, m * random.uniform(0.5, 4.0), position=random.uniform(0.02, 0.3), **given)  # type: ignore[arg-type]


KINDS: tuple[set[str], ...] = (
    set(),
    {"rough"},
    {"rough", "backlash"},
    {"rough", "effects", "backlash", "encoder"},
    {"load"},
    {"rough", "load", "backlash", "effects"},
    {"drive"},
    {"rough", "drive", "load", "encoder"},
)


@pytest.mark.parametrize("kinds", KINDS, ids=lambda kinds: " ".join(sorted(kinds)))
@pytest.mark.parametrize("fraction", [0.0, 0.37])
@pytest.mark.usefixtures("uncompiled")
def test_a_wall_moves_as_the_servo_alone(kinds: set[str], fraction: float, thorough: bool) -> None:
    for seed in range(20 if thorough else 2):
        random = np.random.default_rng(seed)
        servo = drawn(random, kinds)
        delay = (int(random.integers(0, 4)) + fraction) * PERIOD
        stiffness, damping = 500.0 * servo.inertia, 2.0 * servo.inertia
        side: Side = "above" if seed % 2 else "both"
        samples = int(random.integers(1, 4))
        wall = wall_of(
            servo,
            period=PERIOD,
            delay=delay,
            virtual_damping=damping,
            one_sided=side == "above",
            velocity_samples=samples,
        )
        many = Loop(wall, stiffness, servo.position, noise=noise_of(servo, PERIOD, PAST))
        course = many.run(PAST)
        mechanism, law = Mechanism(servo, 0), ProgramWall(stiffness, damping, 0.0, side)
        estimator, delay_ns = velocity_estimator(PERIOD, samples), round(delay * 1e9)
        pending: list[tuple[int, float]] = []
        for k in range(PAST):
            now_ns = k * PERIOD_NS
            while pending and pending[0][0] <= now_ns:
                mechanism.command(pending[0][1], pending.pop(0)[0])
            mechanism.advance(now_ns)
            seen = mechanism.measured()[0]
            pending.append((now_ns + delay_ns, law.torque(seen, estimator.update(seen, 1))))
            while pending and pending[0][0] < now_ns + PERIOD_NS:
                mechanism.command(pending[0][1], pending.pop(0)[0])
            mechanism.advance(now_ns + PERIOD_NS)
            # With a drive the steps of its loop begin at other instants where there is a lag.
            near = 2e-5 if "drive" in kinds else 1e-9
            assert course[k, 2] == pytest.approx(
                seen, abs=near + (2e-3 if "encoder" in kinds else 0)
            )
            if "encoder" not in kinds or k < 20:
                place = mechanism.motor_position if servo.encoder == "motor" else mechanism.position
                assert course[k, 0] == pytest.approx(place, abs=near)


def test_it_is_what_the_program_does(tmp_path: Path) -> None:
    log = tmp_path / "run.hwlog"
    sets = ["servo.coulomb=0.05", "servo.counts_per_rev=4096", "servo.backlash=0.001"]
    sets += ("servo.torque_limit=2", "servo.torque_step=0.01", "servo.delay=0.0013")
    sets += ("delay.steps=2", "wall.velocity_samples=3", "guard.mode=off")
    options = [part for each in sets for part in ("--set", each)]
    words = ["run", "paper-table2", "--duration", "0.5", "--log", log, "--json", "--no-plot"]
    assert call(*words, *options) == 0
    rows = LogReader.open(log).rows()
    servo = TrueServo(1.0, 0.1, 0.05, backlash=0.001, torque_limit=2.0, torque_step=0.01)
    wall = wall_of(servo, period=PERIOD, delay=0.0033, virtual_damping=0.1, velocity_samples=3)
    # The first period comes before the first tick: the servo rests in it, as here.
    course = Loop(wall, 300.0, 0.01).run(rows.size)
    np.testing.assert_allclose(rows["position"], course[:, 2], rtol=0, atol=1e-12)
    assert np.ptp(rows["position"]) > 0.01


@pytest.mark.whole
@pytest.mark.parametrize(
    "kinds",
    [*(pytest.param(each, marks=pytest.mark.thorough) for each in KINDS[1:-2:2]), KINDS[-1]],
    ids=lambda kinds: " ".join(sorted(kinds)),
)
def test_compiled_walls_move_to_the_last_bit_as_the_source_does(
    kinds: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("numba", reason="pip install 'haptic-wall[fast]'")
    servo = drawn(np.random.default_rng(1), kinds)
    found = []
    for side in (False, True):
        wall = wall_of(
            servo, period=PERIOD, delay=1.3e-3, virtual_damping=servo.inertia, one_sided=side
        )
        noise = noise_of(servo, PERIOD, 2000)
        for made in ("compiled", "source"):
            course = Loop(wall, 500.0 * servo.inertia, 0.1, noise=noise).run(200)
            functions = compiled() if made == "compiled" else None
            run = search.onset if functions is None else functions.onset
            guess = 2e3 * servo.inertia
            found.append((course, run(wall, *buffers(wall, noise), 0.03, guess, 0.3)))
            monkeypatch.setattr(walls, "compiled", lambda: None)
        monkeypatch.undo()
    for one, other in (found[:2], found[2:]):
        np.testing.assert_allclose(one[0], other[0], rtol=0.0, atol=1e-12)
        assert one[1] == pytest.approx(other[1], rel=1e-6, abs=1e-9)


@pytest.mark.usefixtures("uncompiled")
def test_what_has_grown_out_of_all_bounds_is_no_error() -> None:
    wall = wall_of(TrueServo(1e-3, torque_limit=math.inf), period=1e-3, delay=0, virtual_damping=0)
    assert not abs(Loop(wall, 1e6, 0.1).run(1000)[-1, 0]) < 1e6


# Loads


@pytest.mark.whole
def test_the_simulated_limit_of_a_load_without_friction_is_the_exact_one() -> None:
    sets = ["servo.coulomb=0", "servo.counts_per_rev=0", "wall.side=both", "servo.torque_step=0"]
    sets += ("servo.load_inertia=0.003", "servo.transmission_stiffness=200")
    sets += ("servo.transmission_damping=0.03",)
    for side in ("output", "motor"):
        config = load_config("simulated", (*sets, f"servo.encoder={side}")).config
        asked = MapQuestion(MapSettings.of(config), [0.0, 0.05], [1], [0.03])
        found = critical_map(asked, executor=AtOnce())
        np.testing.assert_allclose(found.stiffness[0, :, 0], found.exact[0], rtol=1e-3)


@pytest.mark.usefixtures("uncompiled")
def test_contacts_of_a_load_return_what_the_theory_says() -> None:
    phases = np.linspace(1e-9, 1.0, 65)
    for seed in (0, 2):
        servo = drawn(np.random.default_rng(seed), {"load"})
        load = servo.load_inertia, servo.transmission_stiffness, servo.transmission_damping
        masses = servo.inertia, servo.damping, *load
        loop_of = (0.5 * servo.damping, PERIOD, PERIOD)
        stiffness = 0.5 * float(
            chain_boundary(*two_masses(*masses, encoder=servo.encoder), *loop_of).stiffness
        )
        wall = wall_of(
            servo, period=PERIOD, delay=PERIOD, virtual_damping=loop_of[0], one_sided=True
        )
        wall = wall._replace(limit=math.inf)
        found = returned(wall, *buffers(wall), stiffness, 0.03)
        chain, _ = two_masses(*masses, encoder=servo.encoder)
        every = chain.take(np.zeros(phases.size, dtype=np.int64))
        at = (np.full(phases.size, stiffness), np.full(phases.size, loop_of[0]))
        ratio = chain_returned(every, PERIOD, PERIOD, *at, phases, 1, 10_000)
        assert math.exp(found) == pytest.approx(float(np.max(ratio)), abs=STATED_RATIO)
