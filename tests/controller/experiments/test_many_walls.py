"""Many loops at once run to the last bit as each alone: built from parts, and as the program."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.cli.main import main
from haptic_wall.controller.experiments.maps.many_walls import Loops
from haptic_wall.controller.experiments.maps.walls import PARTS, Walls, blocks, split_delay
from haptic_wall.controller.laws.delay import DelayRing
from haptic_wall.controller.laws.velocity import velocity_estimator
from haptic_wall.controller.laws.wall import Wall
from haptic_wall.controller.logs.file import read_log
from haptic_wall.hw.plant.body import PlantParameters, State, step
from haptic_wall.hw.plant.current_loops import CurrentLoopParameters
from haptic_wall.hw.plant.encoders import ManyEncoderErrors
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.settings import TrueServo
from tests.cases import sampled

PERIOD = 1e-3


def make(n: int, **given: object) -> Walls:
    """Walls on a small servo; what is given replaces the plain ones."""
    values: dict[str, object] = {
        "inertia": 0.012,
        "damping": 0.0117,
        "coulomb": 0.0,
        "counts_per_radian": 0.0,
        "backlash": 0.0,
        "torque_limit": math.inf,
        "torque_step": 0.0,
        "stiffness": np.linspace(4.0, 12.0, n),
        "virtual_damping": 0.02,
        "period": PERIOD,
        "velocity_samples": 1,
        "one_sided": False,
        "delay": 0.0,
    }
    values.update(given)
    arrays: dict[str, Any] = {
        name: np.broadcast_to(np.asarray(value), (n,)) for name, value in values.items()
    }
    delay = arrays.pop("delay")
    whole, lag, rest = split_delay(delay, arrays["period"])
    return Walls(**arrays, whole=whole, lag=lag, rest=rest, effects=None)


def alone(walls: Walls, i: int, start: float, velocity: float, periods: int) -> list[float]:
    """The measured positions of one wall, from the program's own scalar parts."""
    assert walls.current_loop is None
    names = Walls.__dataclass_fields__.keys() - set(PARTS)
    w = {name: getattr(walls, name)[i].item() for name in names}
    body = PlantParameters(w["inertia"], w["damping"], w["coulomb"])
    state, followed, half = State(start, velocity), start, 0.5 * w["backlash"]
    wall = Wall(w["stiffness"], w["virtual_damping"], 0.0, "above" if w["one_sided"] else "both")
    estimator = velocity_estimator(w["period"], w["velocity_samples"])
    late, later = DelayRing(w["whole"]), DelayRing(w["whole"] + 1)
    measured = []

    def move(torque: float, duration: float) -> None:
        nonlocal state, followed
        turns: list[float] | None = [] if half else None
        state = step(state, body, torque, duration, turns=turns)
        for position in (*(turns or ()), state.position):
            followed = min(max(followed, position - half), position + half)

    for _ in range(periods):
        position = followed
        if w["counts_per_radian"]:
            position = round(position * w["counts_per_radian"]) / w["counts_per_radian"]
        measured.append(position)
        torque = wall.torque(position, estimator.update(position, 1))
        torque = min(max(torque, -w["torque_limit"]), w["torque_limit"])
        if w["torque_step"]:
            torque = round(torque / w["torque_step"]) * w["torque_step"]
        before, now = later.push(torque), late.push(torque)
        if w["lag"]:
            move(before, w["lag"])
        move(now, w["rest"])
    return measured


@pytest.mark.parametrize(
    "given",
    sampled(
        [
            {},
            {"delay": 3e-3, "velocity_samples": 4},
            {"delay": 1.25e-3, "torque_limit": 0.3},
            {"coulomb": 0.01, "counts_per_radian": 4096 / math.tau, "delay": 2e-3},
            {"one_sided": True, "counts_per_radian": 4096 / math.tau, "torque_step": 0.0048},
            {
                "coulomb": 0.01,
                "counts_per_radian": 4096 / math.tau,
                "backlash": 0.003,
                "delay": 0.4e-3,
                "torque_limit": 0.3,
                "one_sided": True,
            },
            {"backlash": 0.01, "delay": 1e-3 * np.arange(7), "coulomb": 0.002},
        ],
        3,
    ),
    ids=["plain", "delay-difference", "fraction-limit", "friction", "counts", "all", "play"],
)
def test_each_wall_moves_as_if_alone_to_the_last_bit(given: dict[str, Any]) -> None:
    walls = make(7, **given)
    start = np.linspace(-0.02, 0.11, 7)
    velocity = np.where(walls.one_sided, 0.5, 0.0)
    loops = Loops(walls, start, velocity)
    seen = []
    loops.run(400, lambda: seen.append(loops.measured.copy()))
    for i in range(7):
        expected = alone(walls, i, float(start[i]), float(velocity[i]), 400)
        np.testing.assert_array_equal(np.array(seen)[:, i], expected)


@pytest.mark.parametrize(
    ("sets", "given"),
    sampled(
        [
            ((), {"virtual_damping": 0.1, "stiffness": 300.0, "inertia": 1.0, "damping": 0.1}),
            (
                (
                    "servo.coulomb=0.05",
                    "servo.counts_per_rev=4096",
                    "servo.backlash=0.001",
                    "servo.torque_limit=2",
                    "servo.torque_step=0.01",
                    "servo.delay=0.0013",
                    "delay.steps=2",
                    "wall.velocity_samples=3",
                ),
                {
                    "virtual_damping": 0.1,
                    "stiffness": 300.0,
                    "inertia": 1.0,
                    "damping": 0.1,
                    "coulomb": 0.05,
                    "counts_per_radian": 4096 / math.tau,
                    "backlash": 0.001,
                    "torque_limit": 2.0,
                    "torque_step": 0.01,
                    "delay": 0.0033,
                    "velocity_samples": 3,
                },
            ),
        ],
        2,
    ),
    ids=["linear", "all"],
)
def test_it_is_what_the_program_does(
    tmp_path: Path, sets: tuple[str, ...], given: dict[str, float]
) -> None:
    log = tmp_path / "run.hwlog"
    options = [part for each in ("guard.mode=off", *sets) for part in ("--set", each)]
    arguments = ["run", "paper-table2", "--duration", "0.5", "--log", str(log), "--json"]
    with pytest.raises(SystemExit) as ended:
        main([*arguments, "--no-plot", *options])
    assert ended.value.code == 0
    _, rows = read_log(log)
    loops = Loops(make(1, **given), np.array([0.01]))
    seen = []
    loops.run(rows.size, lambda: seen.append((loops.measured[0], loops.torque[0])))
    # The first period comes before the first tick: the servo rests in it, as the arrays do.
    np.testing.assert_allclose(rows["position"], [row[0] for row in seen], rtol=0, atol=1e-12)
    assert np.ptp(rows["position"]) > 0.01


def test_blocks_hold_every_wall_once_and_only_walls_that_are_alike() -> None:
    walls = make(
        60,
        delay=1e-3 * (np.arange(60) % 5) + 0.3e-3 * (np.arange(60) % 2),
        coulomb=0.01 * (np.arange(60) % 3),
    )
    found = list(blocks(walls, size=8))
    assert sorted(np.concatenate(found).tolist()) == list(range(60))
    for index in found:
        assert index.size <= 8
        assert len({(walls.lag[i] > 0, walls.coulomb[i] > 0) for i in index}) == 1


def test_delays_near_whole_periods_are_whole() -> None:
    delay = np.array([0.0, 0.003, 3 * 1e-3 * (1 - 1e-15), 0.0025])
    whole, lag, rest = split_delay(delay, np.full(4, 1e-3))
    assert whole.tolist() == [0, 3, 3, 2]
    assert lag.tolist()[:3] == [0.0, 0.0, 0.0]
    assert lag[3] == pytest.approx(0.0005)
    np.testing.assert_allclose(lag + rest, 1e-3)


def currents(n: int, **given: float) -> CurrentLoopParameters:
    values = {
        "bandwidth": 0.0,
        "dead_band": 0.0,
        "back_emf": 0.0,
        "stall_torque": 4.1,
        "droop": 0.0,
        **given,
    }
    return CurrentLoopParameters(**{name: np.full(n, value) for name, value in values.items()})


@pytest.mark.parametrize("delay", [0.0, 1.3e-3])
@pytest.mark.parametrize(
    "given",
    [
        {"bandwidth": 120.0},
        {"dead_band": 0.05},
        {"back_emf": 4.1 / 4.82, "droop": 0.3},
        {"bandwidth": 300.0, "back_emf": 4.1 / 4.82, "droop": 0.02, "dead_band": 0.01},
    ],
    ids=" ".join,
)
def test_servos_with_a_current_loop_move_as_each_alone(
    given: dict[str, float], delay: float
) -> None:
    """Within the error of the steps, which begin at other instants where there is a lag."""
    walls = replace(
        make(3, delay=delay, coulomb=0.01, torque_limit=4.1), current_loop=currents(3, **given)
    )
    start = np.array([0.02, -0.1, 0.3])
    loops = Loops(walls, start)
    loops.run(300)
    for i, position in enumerate(loops.bodies.position):
        true = TrueServo(
            inertia=0.012,
            damping=0.0117,
            coulomb=0.01,
            counts_per_rev=0,
            delay=delay,
            torque_limit=4.1,
            no_load_speed=4.82,
            position=float(start[i]),
            current_bandwidth=given.get("bandwidth", 0.0),
            dead_band=given.get("dead_band", 0.0),
            back_emf="back_emf" in given,
            current_droop=given.get("droop", 0.0),
        )
        mechanism = Mechanism(true, 0)
        wall = Wall(float(walls.stiffness[i]), 0.02, 0.0, "both")
        estimator = velocity_estimator(PERIOD, 1)
        for k in range(300):
            mechanism.advance(k * 1_000_000)
            seen = mechanism.measured_position()
            mechanism.command(wall.torque(seen, estimator.update(seen, 1)), k * 1_000_000)
        mechanism.advance(300 * 1_000_000)
        assert position == pytest.approx(mechanism.position, abs=2e-5)


def test_an_encoder_that_errs_is_what_the_wall_sees_and_rounds() -> None:
    nothing = np.zeros(3)
    errors = ManyEncoderErrors(
        nothing, nothing, nothing, np.zeros(3, dtype=np.uint64), np.full(3, 0.018)
    )
    walls = replace(make(3, counts_per_radian=100.0), encoder=errors)
    start = np.array([0.01, -0.02, 0.0])
    loops = Loops(walls, start)
    loops.run(1)
    np.testing.assert_allclose(loops.measured, [0.03, 0.0, 0.02], atol=1e-12)
    np.testing.assert_allclose(loops.torque, -walls.stiffness * loops.measured, atol=1e-12)
    np.testing.assert_array_equal(start, [0.01, -0.02, 0.0])
