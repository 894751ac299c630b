"""What the lesson says is what the theory says, and its walls do what their names promise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from haptic_wall.controller.cli.demo_walls import SERVO
from haptic_wall.controller.live.lesson import BOUNDS, facts, own_servo, scenes
from haptic_wall.controller.live.rhythm import rhythm
from haptic_wall.controller.settings.changes import changed
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory import critical_stiffness, linear_limit

CONFIG = load_config("simulated", SERVO).config
LAG = CONFIG.belief().delay.high
OWN = {
    "inertia": 0.01,
    "damping": 0.01,
    "period": 1e-3,
    "delay": 2e-3,
    "virtual_damping": 0.05,
}


def facts_of(scene: str) -> dict[str, float]:
    """What is said of a scene's wall."""
    wall = scenes(CONFIG, LAG)[scene]
    config = changed(CONFIG, [f"{path}={value}" for path, value in wall.items()])
    found: dict[str, float] = facts(config, LAG + config.delay.steps * config.period_ns * 1e-9)
    return found


@pytest.mark.parametrize(
    ("scene", "stable"),
    [
        ("soft", True),
        ("stiff", False),
        ("prompt", True),
        ("late", False),
        ("damped", True),
        ("too_much", False),
        ("far", False),
    ],
)
def test_each_wall_is_on_its_side_of_the_limit(scene: str, stable: bool) -> None:
    found = facts_of(scene)
    wall = scenes(CONFIG, LAG)[scene]
    assert (wall["wall.stiffness"] < found["limit"]) is stable
    assert (found["swings_hz"] is None) is stable


def test_the_limits_are_those_of_the_theory() -> None:
    found = facts(CONFIG, LAG)
    servo = CONFIG.true_servo()
    given = servo.inertia, servo.damping, CONFIG.wall.damping, 1e-3, LAG
    assert found["limit"] == pytest.approx(float(critical_stiffness(*given)))
    assert found["rule"] == pytest.approx(float(linear_limit(*given[1:])))
    assert found["late"] == pytest.approx(0.5e-3 + LAG)


def test_a_readers_servo_has_the_limits_of_the_theory() -> None:
    found = own_servo(OWN)
    exact = float(critical_stiffness(0.01, 0.01, 0.05, 1e-3, 2e-3))
    assert found["exact"] == pytest.approx(exact)
    assert 0.0 < found["one_sided"] <= exact
    beyond = own_servo(OWN | {"virtual_damping": 1.1 * found["damping_ceiling"]})
    assert beyond["exact"] == 0.0
    assert beyond["frequency_hz"] is None


@pytest.mark.parametrize("name", BOUNDS)
@pytest.mark.parametrize("value", [None, "x", math.nan, math.inf, -1.0, 1e9, [1.0], {}])
def test_a_servo_that_cannot_be_is_refused_by_name(name: str, value: object) -> None:
    assert own_servo(OWN | {name: value})["trouble"].startswith(f"{name}: found ")


def test_a_delay_of_too_many_periods_is_refused() -> None:
    assert "50 periods" in own_servo(OWN | {"delay": 0.06})["trouble"]


TIME = np.arange(1000) / 1000.0


@pytest.mark.parametrize("frequency", [5.0, 14.3, 80.0, 200.0])
def test_a_rhythm_is_measured(frequency: float) -> None:
    wave = 0.25 + 0.2 * np.sin(math.tau * frequency * TIME)
    assert rhythm(wave, 1000.0, 0.05) == pytest.approx(frequency, rel=0.02)
    cut = np.minimum(wave, 0.3)
    assert rhythm(cut, 1000.0, 0.05) == pytest.approx(frequency, rel=0.02)


@pytest.mark.parametrize(
    "torque",
    [
        np.zeros(1000),
        0.02 * np.sin(math.tau * 14.0 * TIME),
        TIME,
        np.exp(-5.0 * TIME),
        np.where(TIME < 0.3, np.sin(math.tau * 20.0 * TIME), np.sin(math.tau * 4.0 * TIME)),
        np.full(1000, math.nan),
        np.empty(0),
    ],
    ids=["rest", "small", "ramp", "decay", "irregular", "unknown", "none"],
)
def test_what_has_no_rhythm_is_calm(torque: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
    assert rhythm(torque, 1000.0, 0.05) is None
