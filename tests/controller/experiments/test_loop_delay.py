"""The measured delay is the servo's, its standard error honest, and what is inserted is found."""

import dataclasses
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

import haptic_wall.hw.simulated
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.delay import LoopDelay, delay_report, measure_delay
from haptic_wall.controller.experiments.steps.shaken import (
    ExperimentFailedError,
    Shaken,
    plan_shaking,
    shake,
)
from haptic_wall.controller.experiments.testbed import ExperimentTrippedError, Testbed
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from tests.cases import sampled
from tests.support.trial_servo import TrialServo
from tests.support.truth import Truth
from tests.typed import not_none

SMALL = (
    "servo.inertia=0.0018142",
    "servo.damping=0.0036617",
    "servo.coulomb=0.012833",
    "servo.torque_limit=0.52",
    "servo.torque_step=0.0008",
)
"""An XL330-M288's parameters."""


def config_of(*sets: str, preset: str = "simulated") -> Config:
    return load_config(preset, ("loop.clock=simulated", *sets)).config


def shaken(config: Config, folder: Path, bursts: int = 3, seed: int = 0) -> Shaken:
    limit = not_none(config.servo.torque_limit)
    shaking = plan_shaking(config, limit, config.delay.steps, bursts, seed)
    return shake(Testbed(config, folder), "steps", shaking)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[LoopDelay, list[str]]:
    """A servo with a lag of a fraction of a period, the hand of its preset, 3 periods inserted."""
    config = config_of("servo.delay=0.00137", "delay.steps=3")
    told: list[str] = []
    folder = tmp_path_factory.mktemp("delay")
    return measure_delay(config, folder, [0], bursts=6, tell=told.append), told


def test_the_delay_is_the_servos_lag_and_what_is_inserted(
    found: tuple[LoopDelay, list[str]],
) -> None:
    delay, _ = found
    assert delay.device.value == pytest.approx(0.00137, abs=3 * delay.device.stderr)
    assert delay.total.value == pytest.approx(0.00437, abs=3 * delay.total.stderr)
    assert delay.total.stderr < 1e-4  # a tenth of a period
    assert delay.device.stderr < delay.total.stderr


def test_the_inserted_delay_is_recovered(found: tuple[LoopDelay, list[str]]) -> None:
    reference, inserted = found[0].points
    assert reference.recovered is None
    recovered = not_none(inserted.recovered)
    assert recovered.value == pytest.approx(0.003, abs=3 * recovered.stderr)


def test_the_report_has_bounds_for_the_belief_that_hold_the_truth(
    found: tuple[LoopDelay, list[str]],
) -> None:
    report = delay_report(found[0], 1e-3, 0.0)
    assert report["value"] == found[0].total.value
    assert report["parts"]["inserted"] == pytest.approx(0.003)
    assert report["model_delay"]["low"] < 0.00137 < report["model_delay"]["high"]
    assert [point["delay_steps"] for point in report["points"]] == [0, 3]


def test_what_will_move_is_said_first_and_kept(found: tuple[LoopDelay, list[str]]) -> None:
    delay, told = found
    assert "the shaft will swing over about 0.12 rad" in told[0]
    for point in delay.points:
        rows = point.shaken.played.rows
        assert np.max(np.abs(rows["position"] - rows["position"][0])) < 0.4  # as was said
        assert point.shaken.played.log.exists()


def test_without_friction_and_encoder_it_is_exact(tmp_path: Path) -> None:
    config = config_of("servo.delay=0.00203", preset="paper-table2")
    fit = shaken(config, tmp_path, bursts=1).fit
    assert fit.lag == pytest.approx(0.00203, abs=1e-8)
    assert fit.acceleration == pytest.approx(1.0, rel=1e-6)
    assert fit.decay == pytest.approx(0.1, rel=1e-3)


@pytest.mark.whole
@pytest.mark.parametrize("servo", [(), SMALL], ids=["xm430", "xl330"])
def test_the_standard_error_is_honest(
    servo: tuple[str, ...], tmp_path: Path, thorough: bool
) -> None:
    if servo and not thorough:
        pytest.skip("seconds; --thorough runs it")
    count = 100 if thorough else 5
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
            *servo,
        )
        fit = shaken(config, tmp_path, bursts=3, seed=seed).fit
        off.append((fit.lag - lag) / fit.stderr)
    # The mean square of so many normal errors stays within these bounds but once in 1000 times;
    # on the upper side a fifth is granted to the scatter of the standard error itself.
    spread = 3.1 * np.sqrt(2.0 / count)
    assert 0.2 < np.mean(np.square(off)) < 1.44 * (1.0 + spread)


def test_a_servo_that_does_not_move_is_told(tmp_path: Path) -> None:
    config = config_of("servo.coulomb=3", "model.coulomb=0.09", "servo.hand=none")
    with pytest.raises(ExperimentFailedError, match="the servo does not move: 0 rad"):
        shaken(config, tmp_path)


def test_too_little_torque_against_friction_is_the_users_error(tmp_path: Path) -> None:
    config = config_of("model.coulomb=1.0")
    with pytest.raises(UserError, match=r"raise servo\.torque_limit, or narrow model\.coulomb"):
        measure_delay(config, tmp_path, [])


def test_a_much_lighter_servo_leaves_the_reach_or_trips(tmp_path: Path) -> None:
    config = config_of("model.inertia=0.5", "servo.hand=none", "safety.max_speed=1000")
    with pytest.raises(ExperimentFailedError, match=r"left the ±.* below model\.inertia"):
        shaken(config, tmp_path)
    config = config_of("model.inertia=0.5", "servo.hand=none", "safety.max_speed=4")
    with pytest.raises(ExperimentTrippedError) as tripped:
        shaken(config, tmp_path)
    assert tripped.value.stop_reason == "trip:overspeed"


RIGID = Truth(inertia=0.011951, damping=0.011692, coulomb=0.09039, delay=0.0007)


def tried(monkeypatch: pytest.MonkeyPatch, truth: Truth) -> Config:
    """The simulated servo is this one from now on; what is believed of it is rigid."""
    monkeypatch.setattr(
        haptic_wall.hw.simulated, "SimulatedServo", lambda _, clock: TrialServo(truth, clock)
    )
    return config_of(
        "servo.hand=none",
        "safety.max_speed=1000",
        "model.inertia={value: 0.011951, low: 0.009, high: 0.016}",
        "model.delay={value: 0.001, low: 0, high: 0.003}",
        "model.coulomb=0.09039",
    )


def two_masses(
    hertz: float, damping_ratio: float, load: float, encoder: Literal["output", "motor"]
) -> Truth:
    return dataclasses.replace(RIGID.with_mode(hertz, damping_ratio, load), encoder=encoder)


@pytest.mark.whole
@pytest.mark.parametrize(
    ("hertz", "damping_ratio", "load", "encoder"),
    sampled(
        [
            (46, 0.02, 0.3, "output"),  # was 4.9 ms
            (60, 0.1, 0.3, "motor"),  # was -0.29 ms, with residuals as of a rigid servo
            (30, 0.1, 0.6, "motor"),  # was -2 400 s
        ],
        3,
    ),
)
def test_a_flexible_transmission_tells_no_lag(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    hertz: int,
    damping_ratio: float,
    load: float,
    encoder: Literal["output", "motor"],
) -> None:
    config = tried(monkeypatch, two_masses(hertz, damping_ratio, load, encoder))
    with pytest.raises(
        ExperimentFailedError, match="not that of a rigid servo, and does not determine the lag"
    ):
        shaken(config, tmp_path, bursts=2)


@pytest.mark.whole
@pytest.mark.parametrize("encoder", sampled(["output", "motor"], 2))
def test_a_known_vibration_is_counted(encoder: str, tmp_path: Path) -> None:
    load = ("servo.load_inertia=0.003", "servo.transmission_stiffness=200",
            "servo.transmission_damping=0.0277", f"servo.encoder={encoder}")  # fmt: skip
    config = config_of(*load, "servo.coulomb=0.03", "servo.delay=0.0007", "servo.hand=none")
    found = shaken(config, tmp_path, bursts=2)
    assert found.fit.lag == pytest.approx(0.0007, abs=3 * found.fit.stderr)
    assert found.fit.stderr < 1.5e-4
    whole = 0.011951 + 0.003
    assert found.fit.acceleration == pytest.approx(1 / whole, rel=0.02)


def test_a_stiff_transmission_widens_the_error_and_says_so(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    found = shaken(tried(monkeypatch, two_masses(100, 0.1, 0.3, "output")), tmp_path, bursts=2)
    assert found.fit.lag == pytest.approx(0.0007, abs=found.fit.stderr)
    assert found.fit.stderr > 5e-4
    assert "differs a little from that of a rigid servo" in found.note
