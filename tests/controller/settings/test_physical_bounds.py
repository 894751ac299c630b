"""Each belief about a servo that is accepted has limits, however near to the bounds of physics."""

import math
import random

import pytest

from haptic_wall.controller.errors import ConfigError
from haptic_wall.controller.runtime.assembly import bins_of, gain_table
from haptic_wall.controller.runtime.handover import KnownServo
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.open import open_bus
from tests.cases import sampled

BOUNDS = {
    "inertia": (1e-8, 1e3),
    "damping": (0.0, 1e3),
    "coulomb": (0.0, 1e4),
    "delay": (0.0, 0.1),
    "torque_gain": (1e-3, 10.0),
    "backlash": (0.0, 1.0),
    "load_inertia": (0.0, 1e3),
    "flexible_hz": (0.0, 1e4),
    "flexible_damping_ratio": (0.0, 10.0),
}


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
        low, high = BOUNDS[name]
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
    known = KnownServo(bus.facts[0], bus.traffic)
    bins = bins_of(config, known)
    table = gain_table(config, bins)
    indices = range(len(bins.ages_ns) * len(bins.intervals_ns))
    assert all(0.0 <= table.at(k).stiffness < math.inf for k in indices)
