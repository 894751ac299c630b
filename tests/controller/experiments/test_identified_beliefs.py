"""On servos inside the belief the guard allows no less after an identification than before."""

import math
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from haptic_wall.controller.experiments.commission.verdict import ASKED, GuardQuestion
from haptic_wall.controller.experiments.identify.identification import Identified, identify
from haptic_wall.controller.experiments.identify.identified_config import identified_model
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.dynamixel.tables.models import MODELS
from tests.support.kicked import kicked, least_bad
from tests.support.real_servos import KINDS, believed_servo, truth_of
from tests.support.truth import COUNT
from tests.typed import not_none

AGE = 1.05e-4
"""Of a sample on the bus in memory [s]"""
DAMPINGS = (0.04, 0.1, 0.2)
SHARES = (0.3, 0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0, 2.7, 3.5, 5.0, 7.0)
"""Tried stiffnesses, over about the exact limit"""
Model = Mapping[str, Mapping[str, float]]


class Case(NamedTuple):
    config: Config
    found: Identified
    model: Model
    before: list[float]
    """Allowed stiffness at each of ``DAMPINGS`` [N·m/rad]"""
    after: list[float]
    known: list[float]
    """The same if the servo were known exactly"""

    @property
    def gain(self) -> float:
        """Acting over commanded torque."""
        servo = self.config.servo
        nominal = not_none(MODELS["XM430-W350"].torque_constant)
        return (servo.torque_constant or nominal) / nominal

    @property
    def truth(self) -> tuple[float, float, float]:
        """Inertia, damping and delay."""
        kind = KINDS[1]._replace(torque_limit=KINDS[1].torque_limit * self.gain)
        return truth_of(kind, self.config)

    @property
    def holds(self) -> dict[str, bool]:
        """Whether each bound that limits the guard holds the truth; friction as a sum."""
        servo, gain, model = self.config.servo, self.gain, self.model
        inertia, damping, delay = self.truth
        unit = [model["torque_gain"][end] / gain for end in ("low", "high")]
        speed = np.linspace(0.02, 3.0, 60)
        slow = (servo.static_friction - servo.coulomb) * np.exp(-speed / servo.stribeck_speed)
        droop = servo.current_droop * gain * KINDS[1].torque_limit / KINDS[1].no_load_speed ** 2
        friction = servo.coulomb + slow + damping * speed + droop * speed**2
        least = model["coulomb"]["low"] + model["damping"]["low"] * speed
        return {
            "inertia": model["inertia"]["low"] <= inertia * unit[1]
            and inertia * unit[0] <= model["inertia"]["high"],
            "damping": model["damping"]["low"] <= damping * unit[1],
            "friction": bool(np.all(least <= friction * unit[1])),
            "delay": delay <= model["delay"]["high"],
            "backlash": servo.backlash <= model.get("backlash", {"high": 1.0})["high"],
        }

    def borne(self, damping: float) -> float:
        """Stiffness from which some kick ends in an oscillation of over four counts [N·m/rad]."""
        gain, true = self.gain, self.config.true_servo()
        delay = true.delay + AGE
        true = replace(true, delay=delay, torque_limit=4.1 * gain, torque_constant=0.0, hand="none")
        lag = delay + 1.0 / (math.tau * true.current_bandwidth) + 0.5 * true.current_period
        about = (true.damping / gain + damping) / (5e-4 + lag)

        def goes_on(share: float) -> bool:
            walls = gain * share * about, gain * damping
            tracks = [kicked(true, *walls, kick, 1500, 6.0) for kick in (0.02, 0.3)]
            return any(each is None or np.ptp(each[-250:]) > 8 * COUNT for each in tracks)

        return about * least_bad(goes_on, SHARES, halvings=2)


def case_of(config: Config) -> Case:
    def allowed(model: Model) -> list[float]:
        raw = config.model_dump(mode="json", exclude_none=True)
        raw["model"] |= model
        question = GuardQuestion.of(Config.model_validate(raw), None)
        return [replace(question, age=AGE).decide(ASKED, b).stiffness for b in DAMPINGS]

    with tempfile.TemporaryDirectory() as folder:
        found = identify(config, Path(folder))
    model = identified_model(found, config)
    case = Case(config, found, model, allowed({}), allowed(model), [])
    servo = config.servo
    inertia, damping, delay = case.truth
    exact = {
        "inertia": inertia,
        "damping": damping,
        "delay": delay,
        "coulomb": servo.coulomb,
        "backlash": max(servo.backlash, 1e-6),
        "torque_gain": case.gain,
    }
    known = {name: {"value": v, "low": v, "high": v} for name, v in exact.items()}
    return case._replace(known=allowed(known))


def assert_no_loss(case: Case) -> None:
    assert all(case.holds.values()), case.holds
    assert all(b >= 0.9999 * a for a, b in zip(case.before, case.after, strict=True))


@pytest.mark.whole
def test_the_emulated_servo_is_identified_as_it_is_shipped() -> None:
    """Its encoder's noise is no structure, and friction that fades is known where it is slow."""
    sets = ["loop.clock=simulated", "wall.side=both"]
    case = case_of(load_config("emulated-xm430", sets).config)
    assert_no_loss(case)
    assert not any("residual" in warning for warning in case.found.warnings)
    assert case.found.noise == pytest.approx(math.hypot(0.34, 1 / math.sqrt(12)) * COUNT, rel=0.03)
    assert case.model["coulomb"]["low"] > 0.07 and case.model["delay"]["high"] < 0.002
    assert "flexible_hz" not in case.model  # a horn was believed, which vibrates faster
    borne = [case.borne(damping) for damping in DAMPINGS]
    assert all(a > 0.4 * b for a, b in zip(case.after, borne, strict=True))


@pytest.mark.whole
def test_servos_inside_the_belief_lose_no_stiffness(thorough: bool) -> None:
    cases = [case_of(believed_servo(seed)) for seed in range(40 if thorough else 2)]
    for case in cases:
        assert_no_loss(case)
    shares = [[a / b for a, b in zip(case.after, case.known, strict=True)] for case in cases]
    assert np.median(shares) > 0.4
