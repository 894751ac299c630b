"""Harmonic balances against simulation in time: friction and backlash."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.theory import (
    critical_stiffness,
)
from haptic_wall.controller.theory.harmonic import (
    backlash_gain,
    backlash_limit,
)
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.truth import TrueServo

Array = NDArray[np.float64]
PERIOD, COUNT = 1e-3, 2 * math.pi / 4096


def amplitude_left(true: TrueServo, stiffness: float, virtual_damping: float) -> float:
    """Half of the travel in the last of 50 cycles after a kick [rad]."""
    servo = Mechanism(true, 0)
    cycle = int(2 * math.pi * math.sqrt(true.inertia / stiffness) / PERIOD)
    before, positions = servo.measured()[0], []
    for k in range(50 * cycle):
        servo.advance(k * 1_000_000)
        x = servo.measured()[0]
        torque = -stiffness * x - virtual_damping * (x - before) / PERIOD
        servo.command(torque, k * 1_000_000)
        before = x
        positions.append(servo.position)
    return float(np.ptp(positions[-2 * cycle :])) / 2


@pytest.mark.parametrize(
    ("servo", "virtual_damping", "delay", "degrees"),
    [
        ((0.011951, 0.011692, 0.073), 0.2, 1.2e-3, 0.25),
        ((0.0018142, 0.0036617, 0.018), 0.05, 0.6e-3, 0.25),
        ((0.0018142, 0.0036617, 0.022), 0.03, 1e-3, 0.15),
    ],
)
def test_walls_above_it_swing_on_and_walls_below_it_come_to_rest(
    servo: tuple[float, float, float], virtual_damping: float, delay: float, degrees: float
) -> None:
    width = math.radians(degrees)
    limit = float(backlash_limit(*servo, virtual_damping, PERIOD, delay, width, 4 * COUNT))
    inertia, damping, coulomb = servo
    true = TrueServo(
        inertia=inertia,
        damping=damping,
        coulomb=coulomb,
        backlash=width,
        counts_per_rev=0,
        delay=delay,
        torque_limit=1e3,
        position=0.05,
    )
    assert amplitude_left(true, 1.25 * limit, virtual_damping) > 4 * COUNT
    assert amplitude_left(true, 0.8 * limit, virtual_damping) < 4 * COUNT


def test_friction_raises_it_and_width_and_delay_lower_it() -> None:
    usual = {"coulomb": 0.05, "delay": 2e-3, "width": 0.0044, "amplitude": 4 * COUNT}
    fixed = {"inertia": 0.012, "damping": 0.0117, "virtual_damping": 0.15, "period": PERIOD}

    def limit(**changes: float) -> float:
        return float(backlash_limit(**fixed, **(usual | changes)))

    assert limit(coulomb=0.1) > 1.1 * limit()
    assert limit(width=0.0088) < 0.9 * limit()
    assert limit(delay=4e-3) < 0.9 * limit()
    assert limit(coulomb=0.0) < 0.5 * limit()


def test_hardly_any_backlash_leaves_the_exact_limit() -> None:

    found = backlash_limit(0.012, 0.0117, 1e-9, [0.0, 0.1], PERIOD, 2e-3, 1e-7, 0.01)
    exact = critical_stiffness(0.012, 0.0117, [0.0, 0.1], PERIOD, 2e-3)
    np.testing.assert_allclose(found, exact, rtol=0.02)


def play(motion: Array, width: float) -> Array:
    followed, out = 0.0, []
    for x in np.tile(motion, 2):
        followed = min(max(followed, x - width / 2), x + width / 2)
        out.append(followed)
    return np.array(out[motion.size :])


@pytest.mark.parametrize("ratio", [0.3, 0.501, 1.0, 6.3])
def test_the_gain_of_backlash_is_the_first_harmonic(ratio: float) -> None:
    angle = 2 * np.pi * np.arange(100_000) / 100_000
    output = play(np.cos(angle), 1 / ratio)
    harmonic = complex(2 * np.mean(output * np.exp(-1j * angle)))
    assert complex(backlash_gain(1.0, 1 / ratio)) == pytest.approx(harmonic, abs=2e-3)
