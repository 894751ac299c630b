"""The motions of an identification let go of a shaft that something takes far beyond its reach."""

from haptic_wall.controller.experiments.identify.excitation import (
    Bounds,
    Guess,
    motions,
)
from haptic_wall.controller.laws.program import Program

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
