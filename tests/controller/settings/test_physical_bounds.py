"""What is believed about a servo is bounded by physics, and each belief within has its limits."""

import math
import random

import pytest

from haptic_wall.controller.errors import ConfigError
from haptic_wall.controller.runtime.assembly import guard_decisions
from haptic_wall.controller.runtime.handover import KnownServo
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.fields import fields
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.open import open_bus
from tests.cases import sampled

BOUNDS = {
    "inertia": (1e-8, 1e3, "kg·m²"),
    "damping": (0.0, 1e3, "N·m·s/rad"),
    "coulomb": (0.0, 1e4, "N·m"),
    "delay": (0.0, 0.1, "s"),
    "torque_gain": (1e-3, 10.0, ""),
    "backlash": (0.0, 1.0, "rad"),
    "load_inertia": (0.0, 1e3, "kg·m²"),
    "flexible_hz": (0.0, 1e4, "Hz"),
    "flexible_damping_ratio": (0.0, 10.0, ""),
}


@pytest.mark.parametrize("name", BOUNDS)
def test_a_belief_outside_of_physics_is_refused_in_one_sentence(name: str) -> None:
    low, high, unit = BOUNDS[name]
    field = fields()[f"model.{name}"]
    assert field.unit == unit
    assert f"from {low:g} to {high:.0f}" in field.wanted or f"to {high:g}" in field.wanted
    for value in (high * 1.01, math.nextafter(low, -1.0)):
        with pytest.raises(ConfigError) as caught:
            load_config("simulated", [f"model.{name}={value!r}"])
        (problem,) = caught.value.problems
        assert problem.startswith(f"model.{name}:") and "\n" not in problem


def corner(seed: int) -> Config | None:
    chance = random.Random(seed)
    sets = [
        f"wall.side={chance.choice(['above', 'both'])}",
        f"guard.mode={chance.choice(['stable', 'passive', 'off'])}",
        f"wall.damping={chance.choice([0, 0.02, 1, 100])}",
        f"wall.stiffness={chance.choice([1, 8, 1e6])}",
    ]
    rigid = [name for name in BOUNDS if name != "load_inertia" and "flexible" not in name]
    for name in chance.sample(rigid, chance.randint(1, len(rigid))):
        low, high, _ = BOUNDS[name]
        least = math.log10(max(low, 1e-9 * high))
        drawn = [
            chance.choice([low, high, 10 ** chance.uniform(least, math.log10(high))])
            for _ in range(3)
        ]
        a, b, c = sorted(drawn) if chance.random() < 0.5 else 3 * drawn[:1]
        sets.append(f"model.{name}={{value: {b!r}, low: {a!r}, high: {c!r}}}")
    try:
        return load_config("simulated", sets).config
    except ConfigError:
        return None


@pytest.mark.parametrize("seed", sampled(range(40), 40))
def test_each_accepted_belief_about_a_rigid_servo_has_limits(seed: int) -> None:
    config = corner(seed)
    if config is None:
        return
    bus = open_bus(config.servos(), SimulatedClock(), None)
    known = KnownServo(bus.facts[0], bus.traffic, simulated=False)
    decided = guard_decisions(config, known)
    bins = range(len(decided.ages_ns) * len(decided.intervals_ns))
    assert all(0.0 <= decided.table.at(k).stiffness < math.inf for k in bins)
