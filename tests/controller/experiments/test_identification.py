import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from haptic_wall.controller.experiments.estimated import Estimated
from haptic_wall.controller.experiments.identify import identification
from haptic_wall.controller.experiments.identify.bench import UnidentifiableError
from haptic_wall.controller.experiments.identify.fit import Friction
from haptic_wall.controller.experiments.identify.identification import (
    Identified,
    identify,
)
from haptic_wall.controller.experiments.identify.identified_config import (
    identified_config,
    identified_model,
)
from haptic_wall.controller.experiments.identify.motion import motion_of
from haptic_wall.controller.experiments.identify.servo_fit import fit_servo
from haptic_wall.controller.experiments.identify.text import text
from haptic_wall.controller.experiments.identify.vibration import Vibration
from haptic_wall.controller.experiments.testbed import Played, Testbed
from haptic_wall.controller.guard.belief import Bounded
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from tests.typed import not_none

SMALL = (
    "servo.inertia=0.0018142",
    "servo.damping=0.0036617",
    "servo.coulomb=0.012833",
    "servo.torque_limit=0.52",
    "servo.torque_step=0",
    "model.inertia={value: 0.002, low: 0.0016, high: 0.0024}",
    "model.damping={value: 0.003, low: 0.0024, high: 0.0036}",
    "model.coulomb={value: 0.015, low: 0.012, high: 0.018}",
    "model.delay={value: 0.0025, low: 0.0, high: 0.005}",
)
NAMES = ("inertia", "damping", "coulomb", "delay")


def config_of(*sets: str) -> Config:
    return load_config("simulated", (*SMALL, "loop.clock=simulated", *sets)).config


def truth(config: Config) -> list[float]:
    return [getattr(config.servo, name) for name in NAMES]


def far_off(found: Identified, config: Config) -> list[float]:
    """In standard errors."""
    estimates = [getattr(found, name) for name in NAMES]
    return [abs(e.value - t) / e.stderr for e, t in zip(estimates, truth(config), strict=True)]


@pytest.fixture
def rigid(monkeypatch: pytest.MonkeyPatch) -> None:
    """No vibration is looked for, which is a run of its own and changes nothing of the others."""
    monkeypatch.setattr(identification, "find_mode", lambda *_: None)


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory, wholly: bool) -> tuple[Config, Identified]:
    """A servo, and what is found of it; by default of a quarter of the rows."""
    sets = ("servo.delay=0.0037", "servo.kick=0.0003", "wall.stiffness=3", "servo.hand=push")
    config = config_of(*sets, *(() if wholly else ("loop.rate_hz=250",)))
    return config, identify(config, tmp_path_factory.mktemp("usual"))


def test_a_servo_with_another_truth_than_believed_is_found(
    usual: tuple[Config, Identified],
) -> None:
    """Two seeds of scripts/study identify_check have the rest."""
    config, found = usual
    for name, true in zip(NAMES[:3], truth(config)[:3], strict=True):
        assert getattr(found, name).value == pytest.approx(true, rel=0.05)
    assert found.delay.value == pytest.approx(0.0037, abs=1e-4)
    assert max(far_off(found, config)) < 3.5
    assert found.torque_gain == Estimated(1.0, 0.0) and not found.gain_measured
    assert found.backlash is None
    # Nothing is left but the encoder's rounding.
    assert found.residual == pytest.approx(found.rounding, rel=0.1)
    assert all(log.exists() for log in found.logs)
    position = found.played.rows["position"]
    assert np.max(np.abs(position - position[0])) <= 0.6


@pytest.mark.whole
def test_what_a_stall_has_left_unrecorded_spoils_nothing(usual: tuple[Config, Identified]) -> None:
    """The servo went on under torques that the log does not hold, or not at their time."""
    config, found = usual
    rows = found.played.rows
    stalled = np.zeros(rows.size, dtype=bool)
    for begin in range(700, rows.size, 900):
        stalled[begin : begin + 14] = True
    fit = fit_servo(motion_of(rows[~stalled]), math.tau / 4096)
    assert fit.residual == pytest.approx(found.rounding, rel=0.1)
    for name, true in zip(NAMES, truth(config), strict=True):
        assert abs(fit[name] - true) < 3.5 * fit.error(name) + 1e-12


@pytest.mark.whole
@pytest.mark.usefixtures("rigid")
def test_play_is_seen_and_measured(tmp_path: Path) -> None:
    """A third of a count; taken for delay it would be 0.2 ms."""
    play = 0.0005
    config = config_of("servo.delay=0.001", f"servo.backlash={play}")
    found = identify(config, tmp_path)
    assert not_none(found.backlash).value == pytest.approx(play, rel=0.2)
    assert found.delay.value == pytest.approx(0.001, abs=1e-4)
    assert found.inertia.value == pytest.approx(config.servo.inertia, rel=0.05)
    assert found.coulomb.value == pytest.approx(config.servo.coulomb, rel=0.05)


@pytest.mark.whole
@pytest.mark.usefixtures("rigid")
def test_a_measured_current_gives_the_gain(tmp_path: Path) -> None:
    sets = ("loop.clock=simulated", "servo.delay=0.001")
    config = load_config("emulated-ideal", sets).config
    found = identify(config, tmp_path)
    assert found.gain_measured
    assert found.torque_gain.value == pytest.approx(1.0, abs=0.01)
    assert found.inertia.value == pytest.approx(config.servo.inertia, rel=0.05)
    assert found.coulomb.value == pytest.approx(config.servo.coulomb, rel=0.05)
    # The bus adds what a torque takes to travel, less what a request does.
    assert found.delay.value == pytest.approx(0.001, abs=1e-4)


@pytest.mark.parametrize(
    ("sets", "told"),
    [
        (("servo.coulomb=0.6",), r"does not move: pulses of .*, 0\.52 N·m"),
        (("servo.coulomb=0.35",), r"friction takes 0\.3.* of the torque limit"),
        # More than friction holds: the shaft would not have stayed where it was.
        (
            ("servo.gravity=0.1", f"servo.gravity_angle={math.pi / 2}"),
            "a weight, a spring or a hand moves it too",
        ),
    ],
)
def test_a_shaft_that_the_torque_does_not_move_alone_is_told_with_what_was_tried(
    sets: tuple[str, ...], told: str, tmp_path: Path
) -> None:
    with pytest.raises(UnidentifiableError, match=told):
        identify(config_of(*sets), tmp_path)


def test_a_reversed_torque_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Reversed(Testbed):
        def play(
            self, name: str, phases: Sequence[Phase], delay_steps: int | None = None
        ) -> Played:
            played = super().play(name, phases, delay_steps)
            rows = played.rows.copy()
            rows["position"] *= -1.0
            return replace(played, rows=rows)

    monkeypatch.setattr(identification, "Testbed", Reversed)
    with pytest.raises(UnidentifiableError, match="Drive Mode"):
        identify(config_of(), tmp_path)


@pytest.mark.whole
def test_an_ordinary_servo_is_found_and_the_misfit_named(tmp_path: Path) -> None:
    back = 0.8 * 0.0036617
    sets = ("servo.load_friction=0.1", f"servo.damping_back={back}")
    config = config_of("servo.delay=0.002", "servo.kick=0.0005", *sets)
    found = identify(config, tmp_path)
    for said in ("the gear adds 10 % of its load", "backwards; the smaller value is used"):
        (warning,) = (warning for warning in found.warnings if said in warning)
        assert warning.endswith("the model lacks it")
    model = identified_model(found, config)
    for name, true in zip(NAMES, truth(config), strict=True):
        least = back if name == "damping" else true
        assert model[name]["low"] <= least <= model[name]["high"]
    for name, ideal in (("inertia", 0.04), ("damping", 0.1)):
        width = model[name]["high"] - model[name]["low"]
        assert width <= 2.0 * ideal * getattr(config.servo, name)


def test_where_the_motion_tells_less_than_was_believed_the_belief_bounds_the_damping(
    usual: tuple[Config, Identified],
) -> None:
    """The damping and what fades with the speed cannot be told apart by any motion within reach."""
    config, found = usual
    unsure = replace(found, damping=replace(found.damping, stderr=0.01))
    bounds = identified_model(unsure, config)["damping"]
    assert (bounds["low"], bounds["high"]) == (0.0024, 0.0036)
    elsewhere = replace(found, damping=replace(found.damping, value=0.1, stderr=0.01))
    assert identified_model(elsewhere, config)["damping"]["low"] == pytest.approx(0.07)
    # A delay within its error beyond the belief keeps its own upper bound: a longer one is safer.
    late = replace(found, delay=Estimated(0.00504, 2e-5))
    assert identified_model(late, config)["delay"]["high"] > 0.0051 - 1e-9


def test_a_residual_with_structure_narrows_no_belief(usual: tuple[Config, Identified]) -> None:
    config, found = usual
    raw = config.model_dump(mode="json")
    raw["model"]["torque_gain"] = {"value": 1.0, "low": 0.7, "high": 1.4}
    config = Config.model_validate(raw)
    before = config.belief()
    torn = replace(found, torque_gain=Estimated(1.2, 0.01), residual=3.0 * found.rounding)
    model = identified_model(torn, config)
    for name in (*NAMES, "torque_gain"):
        believed = getattr(before, name)
        assert (model[name]["low"], model[name]["high"]) == (believed.low, believed.high)
    # A value that contradicts the belief widens it.
    far = replace(torn, inertia=Estimated(0.006, 1e-5))
    assert identified_model(far, config)["inertia"]["high"] == pytest.approx(0.0051)
    # Noise of the readings is no structure.
    noisy = replace(torn, noise=math.sqrt(8.8) * found.rounding)
    assert identified_model(noisy, config)["inertia"]["low"] > before.inertia.low


def test_the_told_noise_is_no_more_than_the_residual_it_is_a_part_of(
    usual: tuple[Config, Identified],
) -> None:
    config, found = usual
    found = replace(found, residual=4.4e-4, noise=4.57e-4)
    told = "esidual 0.44 mrad, 0.44 by noise and rounding"
    assert told in text(found)
    assert told in identified_config(config, found, "mine")


@pytest.mark.parametrize("seed", range(20))
def test_the_bounds_are_inside_of_those_believed_and_hold_the_friction_as_a_sum(
    usual: tuple[Config, Identified], seed: int
) -> None:
    """For whatever values and errors a fit gives, as long as they do not contradict the belief."""
    config, found = usual
    random = np.random.default_rng(seed)
    raw = config.model_dump(mode="json")
    raw["model"]["torque_gain"] = {"value": 1.0, "low": 0.7, "high": 1.4}
    raw["model"]["backlash"] = {"value": 0.002, "low": 0.0, "high": 0.004}
    config = Config.model_validate(raw)
    belief = config.belief()
    drawn = {}
    for name in (*NAMES, "backlash"):
        bounds = getattr(belief, name)
        value = float(random.uniform(bounds.low, bounds.high))
        drawn[name] = Estimated(value, float(random.uniform(0.0, bounds.high)))
    drawn["inertia"] = Estimated(drawn["inertia"].value, 1e-6)
    speed = np.linspace(0.1, 4.0, 20)
    fading = np.exp(-speed / random.uniform(0.5, 3.0))
    sums = drawn["coulomb"].value * (1.0 + random.uniform(0.0, 1.5) * fading)
    sums = sums + drawn["damping"].value * speed
    friction = Friction(speed, sums, np.full(20, 1e-5))
    gain = float(random.uniform(0.8, 1.2))
    changed: dict[str, Any] = {**drawn, "torque_gain": Estimated(gain, 0.0)}
    unsure = replace(found, friction=friction, **changed)
    model = identified_model(unsure, config)
    inertia = model["inertia"]
    # In commanded units; the guard's corner believes the highest gain.
    for name in ("damping", "coulomb"):
        least = getattr(belief, name).low / belief.torque_gain.high
        assert model[name]["low"] / gain >= 0.99999 * least
    assert inertia["low"] / gain >= belief.inertia.low / belief.torque_gain.high
    for name in ("delay", "backlash"):
        assert model[name]["high"] <= getattr(belief, name).high
    assert all(each["low"] <= each["value"] <= each["high"] for each in model.values())
    low = model["coulomb"]["low"] + model["damping"]["low"] * speed
    believed = belief.coulomb.low + belief.damping.low * speed
    assert np.all(low <= np.maximum(gain * sums, believed) + 1e-9)


def test_a_load_is_written_as_a_part_of_the_whole_inertia(usual: tuple[Config, Identified]) -> None:
    """Or the file would be refused: with all effects the two disagreed by a percent."""
    config, found = usual
    load = 1.01 * found.inertia.value
    heavy = Vibration(
        Bounded(60.0, 50.0, 70.0),
        Bounded(0.02, 0.01, 0.04),
        Bounded(load, 0.8 * load, 1.2 * load),
        load,
    )
    model = identified_model(replace(found, vibration=heavy), config)
    raw = config.model_dump(mode="json")
    raw["model"] |= model
    assert Config.model_validate(raw).model.load_inertia is not None
    assert model["load_inertia"]["high"] == pytest.approx(1.2 * load, rel=1e-5)


def test_the_configuration_holds_the_truth_and_little_else(
    usual: tuple[Config, Identified], tmp_path: Path
) -> None:
    config, found = usual
    path = tmp_path / "mine.yaml"
    path.write_text(identified_config(config, found, "simulated"))
    loaded = load_config(str(path)).config
    assert loaded.model_copy(update={"model": config.model}) == config
    for name, true in zip(NAMES, truth(config), strict=True):
        estimate = getattr(loaded.model, name)
        assert estimate.low <= true <= estimate.high
        assert estimate.high - estimate.low <= max(0.11 * true, 2e-4)
    assert (
        not_none(loaded.model.torque_gain).value == not_none(loaded.model.torque_gain).high == 1.0
    )
    assert yaml.safe_load(path.read_text())["wall"]["stiffness"] == 3.0


def test_of_several_axes_only_the_identified_one_changes(
    usual: tuple[Config, Identified], tmp_path: Path
) -> None:
    _, found = usual
    sets = ["axes={a: {wall: {law: spring}}, b: {wall: {law: none}, servo: {inertia: 0.03}}}"]
    whole = load_config("simulated", sets).config
    path = tmp_path / "mine.yaml"
    path.write_text(identified_config(whole.each["a"], found, "simulated:a", "a", whole))
    written = load_config(str(path)).config
    assert written.each["b"] == whole.each["b"]
    unchanged = {"model": whole.each["a"].model}
    assert written.each["a"].model_copy(update=unchanged) == whole.each["a"]
    assert not_none(written.each["a"].model.inertia).low < found.inertia.value
