"""How large a step is, against the equation of motion integrated beside it."""

import math

import numpy as np
import pytest

from controller.detector.oscillation import DetectorSettings
from controller.detector.retreat import SHARES, UNKNOWN, Swing, softer

M, B_SERVO = 0.012, 0.012
SERVO = DetectorSettings(1e-3, inertia=M, damping=B_SERVO, coulomb=0.0)


def wall(stiffness, growth):
    """The delay at which this spring's oscillation grows so: K L - b = 2 m s."""
    return (2.0 * M * growth + B_SERVO) / stiffness


def largest(stiffness, lag, share, past):
    """The largest swing of x'' = -(k x - k lag v) - b v within a cycle after a step to a share.

    The motion starts at a turn at 1 and runs ``past`` seconds on the old spring.
    """
    x, v, dt = 1.0, 0.0, 1e-5
    t = 0.0
    far = 0.0
    # The longest that is judged: a cycle of the softer spring.
    end = past + math.tau * math.sqrt(M / (share * stiffness))
    while t < end:
        k = stiffness if t < past else share * stiffness
        a = (-k * x + (k * lag - B_SERVO) * v) / M
        v += a * dt
        x += v * dt
        t += dt
        if t >= past:
            far = max(far, abs(x))
    return far


@pytest.mark.parametrize("growth", [0.2, 1.0, 4.0])
@pytest.mark.parametrize("past", [0.0, 0.15, 0.3, 0.6, 0.9])
def test_no_other_step_leaves_much_less_motion(growth, past):
    stiffness = 20.0
    hertz = math.sqrt(stiffness / M) / math.tau
    half_s = 0.5 / hertz
    lag = wall(stiffness, growth)
    swing = Swing(growth, hertz, 1.0, past * half_s)
    chosen = softer(swing, SERVO, stiffness, 0.0, lag - 0.5e-3)
    now = {share: largest(stiffness, lag, share, past * half_s) for share in SHARES}
    turn = {share: largest(stiffness, lag, share, half_s) for share in SHARES}
    least = min(*now.values(), *turn.values())
    left = now[chosen] if chosen is not None else min(turn.values())
    # Growth is counted as if the frequency did not change with it, and to 2 % of the best moment.
    # A step is never thought to be timed better than to 4 % of the energy.
    assert left <= 1.2 * least


def test_what_is_not_known_is_halved_at_once():
    unknown = DetectorSettings(1e-3)
    assert softer(Swing(1.0, 5.0, 0.1, 0.05), unknown, 8.0, 0.0, 0.0) == UNKNOWN
    stable = (SERVO, 8.0, 0.0, 0.0)
    assert softer(Swing(math.nan, 5.0, 0.1, 0.05), *stable) == UNKNOWN
    assert softer(Swing(-1.0, 5.0, 0.1, 0.05), *stable) == UNKNOWN


def test_growth_that_is_not_seen_yet_is_what_is_believed():
    at_turn = Swing(math.nan, 6.0, 0.05, 0.0)
    believed = (SERVO, 17.0, 0.0, 3e-3)
    growth = (17.0 * 3.5e-3 - B_SERVO) / (2.0 * M)
    assert softer(at_turn, *believed) == softer(Swing(growth, 6.0, 0.05, 0.0), *believed)


def test_friction_of_any_kind_asks_for_less():
    at_turn = Swing(2.0, 6.0, 0.05, 0.0)
    bare = softer(at_turn, SERVO, 17.0, 0.0, 0.0)
    assert softer(at_turn, SERVO, 17.0, 0.05, 0.0) > bare
    rough = DetectorSettings(1e-3, inertia=M, damping=B_SERVO, coulomb=0.1)
    assert softer(at_turn, rough, 17.0, 0.0, 0.0) > bare


def test_a_swing_of_any_size_gets_an_answer():
    rng = np.random.default_rng(1)
    for _ in range(1000):
        growth, hertz, amplitude, past = np.exp(rng.uniform(-12.0, 12.0, 4))
        answer = softer(Swing(growth, hertz, amplitude, past), SERVO, 20.0, 0.0, 1e-3)
        assert answer is None or 0.0 < answer < 1.0
