"""A weight and cogging do not pass for delay: what they move is taken out of the torque steps."""

from pathlib import Path

import pytest

from haptic_wall.controller.experiments.delay import measure_delay
from haptic_wall.controller.settings.load import load_config
from tests.controller.experiments.ordinary_servos import Effects

ORDINARY = Effects(stiction=1.25, cogging=0.03, periods=24, phase=0.7, gravity=0.1, hanging=0.6)
BURSTS = 4


@pytest.mark.parametrize("lag", [0.0, 0.00137])
def test_the_lag_of_an_ordinary_servo_is_found(tmp_path: Path, thorough: bool, lag: float) -> None:
    if lag and not thorough:
        pytest.skip("seconds; --thorough runs it")
    belief = "model.delay={value: 0.001, low: 0.0, high: 0.002}"
    sets = ["loop.clock=simulated", f"servo.delay={lag}", belief]
    config = ORDINARY.on(load_config("simulated", sets).config)
    found = measure_delay(config, tmp_path, [0], BURSTS)
    assert found.device.value == pytest.approx(lag, abs=2.5 * found.device.stderr)
    assert found.device.stderr < 1e-4
    assert found.notes == []
