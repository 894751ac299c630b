"""The energy at the motor is told from an output's motion and the torque, with a known link."""

import math

import numpy as np
import pytest

from scripts.trials.links import DAMPING, INERTIA, PERIOD, LinkRun
from scripts.trials.motor_energy import noticed


def run(hertz: float, late: int, fed: float) -> LinkRun:
    """A steady vibration into which the motor puts ``fed`` times what is dissipated."""
    load, ratio, rate = 0.5 * INERTIA, 0.02, math.tau * hertz
    over = -load / INERTIA
    moving = INERTIA * load / (INERTIA + load)
    lost = (2.0 * ratio * moving * rate * (1.0 - over) ** 2 + DAMPING * over**2) / over**2
    # a torque in proportion to the motor's speed, over the middle of the interval that it acts in
    time = np.arange(2000) * PERIOD
    shape = math.sin(0.5 * rate * PERIOD) / (0.5 * rate * PERIOD)
    acts = time + (late + 0.5) * PERIOD
    torque = fed * lost * over * 0.02 * rate * np.cos(rate * acts) / shape
    position = 0.02 * np.sin(rate * time)
    return LinkRun(load, hertz, ratio, late * PERIOD, position, torque, math.nan)


@pytest.mark.parametrize("hertz", [25.0, 60.0, 150.0])
@pytest.mark.parametrize("late", [0, 2])
def test_what_is_fed_is_told_from_what_is_dissipated(hertz: float, late: int) -> None:
    when, size = noticed(run(hertz, late, 1.4))
    assert when < 1.0
    assert size == pytest.approx(0.02 / (math.tau / 4096), rel=0.1)
    for fed in (1.0, 0.0, -2.0):
        assert math.isnan(noticed(run(hertz, late, fed))[0])
