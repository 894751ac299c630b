"""A law of many ridges on a believed link must not turn it for ever; its own simulation."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from haptic_wall.controller.guard.guard import decide
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from tests.support.beliefs import belief

PERIOD = 1e-3
WHOLE, LOAD, HZ, RATIO, OWN = 0.00534, 0.00215, 13.0, 0.0068, 0.00077
SAMPLES, DELAY = 4, 0.00063
RIDGE = 0.1
"""Distance of the ridges [rad]; the shaft starts so fast that it meets them at 13 Hz"""


def commanded(*, linear: bool) -> tuple[float, float]:
    """Return stiffness and damping on a servo that is known exactly."""
    servo = belief(
        inertia=WHOLE,
        damping=OWN,
        delay=DELAY,
        load_inertia=LOAD,
        flexible_hz=HZ,
        flexible_damping_ratio=RATIO,
    )
    asked = Request(1e6, 1.0, "both", SAMPLES, law="texture", linear=linear)
    found = decide(asked, GuardSettings(), Situation(servo, PERIOD, 1e9, 0.0), [0.0])[0]
    return found.stiffness, found.damping


def speeds(stiffness: float, damping: float, ticks: int = 4_000) -> tuple[float, float]:
    """Return the largest speed of the load in the third and the last quarter [rad/s]."""
    m, moving, rate = WHOLE - LOAD, (WHOLE - LOAD) * LOAD / WHOLE, math.tau * HZ
    k, d = moving * rate**2, 2.0 * RATIO * moving * rate
    a = np.zeros((5, 5))
    a[0, 1] = a[2, 3] = 1.0
    a[1] = np.array([-k, -(OWN + d), k, d, 1.0]) / m
    a[3, :4] = np.array([k, d, -k, -d]) / LOAD
    late, then = expm(a * DELAY), expm(a * (PERIOD - DELAY))
    before, after = (then @ late)[:4, :4], then[:4, :4]
    of_last, of_this = after @ late[:4, 4], then[:4, 4]
    state = np.array([0.3, 1.05 * HZ, 0.3, 1.05 * HZ]) * RIDGE
    history, torque, wave = [0.0] * SAMPLES, 0.0, math.tau / RIDGE
    found = np.zeros(ticks)
    for tick in range(ticks):
        x = float(state[2])
        v = (x - history[tick % SAMPLES]) / (SAMPLES * PERIOD)
        history[tick % SAMPLES] = x
        last, torque = torque, -stiffness * math.sin(wave * x) / wave - damping * v
        state = before @ state + of_last * last + of_this * torque
        found[tick] = state[3]
    quarter = ticks // 4
    return np.abs(found[2 * quarter : 3 * quarter]).max(), np.abs(found[3 * quarter :]).max()


@pytest.mark.whole
def test_ridges_at_the_frequency_of_the_vibration_do_not_turn_a_link_for_ever() -> None:
    third, last = speeds(*commanded(linear=False))
    assert last < 0.8 * third
    third, last = speeds(*commanded(linear=True))
    assert last > 0.97 * third > 0.3, "a law of one slope is allowed more"
