"""The motions of an identification let go of a shaft that something takes far beyond its reach."""

import math
from dataclasses import replace

import pytest

from haptic_wall.controller.experiments.identify.excitation import (
    Bounds,
    Guess,
    motions,
)
from haptic_wall.controller.laws.program import Program
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.truth import TrueServo
from tests.cases import sampled

BOUNDS = Bounds(reach=0.6, torque=4.0, speed=4.0, step=0.0015, period=1e-3)
GUESS = Guess(inertia=0.012, damping=0.012, coulomb=0.09, delay=2e-3)


def program() -> Program:
    return Program(motions(GUESS, BOUNDS, 0.3), BOUNDS.period, BOUNDS.torque)


def test_a_shaft_that_is_taken_away_is_let_go_at_once() -> None:
    """A weight, a hand, a spring that is unstable: no motion goes on pulling."""
    playing = program()
    playing.torque(0.0, 0.0)
    for _ in range(100):
        torque = playing.torque(2.0, 0.0)
    assert playing.done and torque == 0.0


def test_a_shaft_that_was_thrown_beyond_the_reach_is_brought_home() -> None:
    """Where the next, smaller motions begin."""
    playing = program()
    playing.torque(0.0, 0.0)
    playing.torque(0.7, 0.0)
    torques = [playing.torque(0.7, 0.0) for _ in range(100)]
    assert not playing.done and min(torques) < -GUESS.coulomb


@pytest.mark.whole
@pytest.mark.parametrize("hanging", sampled([1.9, -math.pi / 2, 2.8], 3))
def test_a_weight_leaves_the_motions_as_large_as_planned(hanging: float) -> None:
    """It is 0.8 of the friction, and drives a coasting shaft that much further."""
    weight = 0.8 * GUESS.coulomb
    known = replace(GUESS, sine=weight * math.cos(hanging), cosine=-weight * math.sin(hanging))
    assert furthest(known, weight, hanging) < 0.36
    if abs(math.cos(hanging)) < 0.5:  # it does not hang near the start or above it
        assert furthest(GUESS, weight, hanging) > BOUNDS.reach


def furthest(guess: Guess, weight: float, hanging: float) -> float:
    """Play the motions of about 0.3 rad to each side on a servo with a weight."""
    servo = Mechanism(
        TrueServo(
            inertia=GUESS.inertia,
            damping=GUESS.damping,
            coulomb=GUESS.coulomb,
            gravity=weight,
            gravity_angle=hanging,
        ),
        0,
    )
    playing = Program(motions(guess, BOUNDS, 0.3), BOUNDS.period, BOUNDS.torque)
    before = far = 0.0
    for tick in range(60_000):
        servo.advance(tick * 1_000_000)
        position = servo.position
        servo.command(
            playing.torque(position, (position - before) / BOUNDS.period), tick * 1_000_000
        )
        before, far = position, max(far, abs(position))
        if playing.done:
            return far
    raise AssertionError("the program does not end")
