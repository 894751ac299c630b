"""What the trial's servo adds to the program's plant: the motor's gain, and an operator's mass."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_wall.hw.clock import SimulatedClock
from tests.support.operators import Operator, operator_of
from tests.support.trial_servo import TrialServo
from tests.support.truth import Truth

FREE = Truth(0.012, counts_per_rev=0, torque_gain=1.5)


@pytest.mark.parametrize("truth", [FREE, FREE.with_mode(500.0, 0.1, 0.5)], ids=["rigid", "link"])
def test_a_mass_is_moved_until_the_operator_lets_go(truth: Truth) -> None:
    def speeds(operator: Operator) -> list[float]:
        clock = SimulatedClock()
        servo = TrialServo(truth, clock, operator)
        for i in range(201):
            servo.request()
            servo.write([0.2])
            clock.wait_until((i + 1) * 1_000_000)
        return [1e2 * (servo.outputs[k + 10] - servo.outputs[k]) for k in (90, 190)]

    held = operator_of(0.0, 0.0, np.zeros(100), mass=0.012)
    # 0.3 N·m on 0.024 kg·m² for 0.1 s, then on 0.012.
    assert speeds(held) == pytest.approx([1.19, 3.62], abs=0.03)
    assert speeds(Operator())[0] == pytest.approx(2.38, abs=0.03)
