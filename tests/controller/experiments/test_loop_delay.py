"""The measured delay is that of servo and insertion, and its standard error is honest."""

from pathlib import Path

import numpy as np
import pytest

from haptic_wall.controller.experiments.delay import measure_delay
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from tests.cases import sampled


def config_of(*sets: str, preset: str = "simulated") -> Config:
    return load_config(preset, ("loop.clock=simulated", *sets)).config


def lag_of(config: Config, folder: Path) -> tuple[float, float]:
    found = measure_delay(config, folder)
    return found.device.value, found.device.stderr


@pytest.mark.whole
def test_the_standard_error_is_honest(tmp_path: Path, thorough: bool) -> None:
    count = 40 if thorough else 2
    off = []
    for seed in range(count):
        random = np.random.default_rng(seed)
        lag = float(random.uniform(0.0, 0.006))
        steps = int(random.integers(0, 6))
        config = config_of(
            f"servo.delay={lag}",
            f"delay.steps={steps}",
            "servo.hand=none",
            "model.delay={value: 0.003, low: 0, high: 0.006}",
        )
        found, error = lag_of(config, tmp_path)
        off.append((found - lag) / error)
    # The mean square of so many normal errors exceeds this once in 1000 times.
    assert np.mean(np.square(off)) < 1.44 * (1.0 + 3.1 * np.sqrt(2.0 / count))


@pytest.mark.whole
@pytest.mark.parametrize("encoder", sampled(["output", "motor"], 1))
def test_a_load_that_vibrates_leaves_the_lag(encoder: str, tmp_path: Path) -> None:
    load = ("servo.load_inertia=0.003", "servo.transmission_stiffness=200",
            "servo.transmission_damping=0.0277", f"servo.encoder={encoder}")  # fmt: skip
    config = config_of(*load, "servo.coulomb=0.03", "servo.delay=0.0007", "servo.hand=none")
    found, error = lag_of(config, tmp_path)
    assert found == pytest.approx(0.0007, abs=3 * error)
    assert error < 1.5e-4
