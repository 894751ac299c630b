"""On servos inside the belief the guard allows no less after an identification than before."""

import math
import tempfile
from collections.abc import Callable, Mapping
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
from haptic_wall.hw.dynamixel.tables import MODELS
from tests.support.real_servos import DROOP, KINDS, LOAD, STATIC, STRIBECK, truth_of
from tests.support.truth import COUNT
from tests.typed import not_none

AGE = 1.05e-4
"""Of a sample on the bus in memory [s]"""
DAMPINGS = (0.04, 0.1, 0.2)
Model = Mapping[str, Mapping[str, float]]


def believed_servo(seed: int) -> Config:
    """Return the preset ``emulated-xm430`` with another truth inside its belief.

    Effects that the belief lacks are drawn beside it. One servo in four has the horn on its
    transmission, and no backlash.
    """
    config = load_config("emulated-xm430").config
    random, belief = np.random.default_rng(seed), config.belief()

    def inside(*names: str) -> list[float]:
        bounds = [getattr(belief, name) for name in names]
        return [math.exp(random.uniform(*np.log((each.low, each.high)))) for each in bounds]

    inertia, damping, coulomb, gain = inside("inertia", "damping", "coulomb", "torque_gain")
    load, stiffness, ratio = inside(
        "load_inertia", "transmission_stiffness", "flexible_damping_ratio"
    )
    lag, period, of_loop = random.uniform((2e-4, 0.0, 0.1), (belief.delay.high, 3e-4, 1.0)).tolist()
    loop = of_loop * (lag - 0.5 * period)
    ends = {
        "backlash": (0.0, belief.backlash.high),
        "encoder_noise": (0.0, 1.0),
        "encoder_eccentricity": (0.0, 0.0087),
        "encoder_phase": (-math.pi, math.pi),
        "dead_band": (0.0, 0.1),
        "current_droop": (0.0, DROOP),
        "static_friction": (coulomb, STATIC[1] * coulomb),
        "stribeck_speed": STRIBECK,
        "load_friction": (0.0, LOAD[1]),
        "kick": (0.0, math.tau / 4096),
    }
    constant = MODELS["XM430-W350"].torque_constant
    assert constant is not None
    servo = {
        **dict(zip(ends, random.uniform(*np.transpose([*ends.values()])).tolist(), strict=True)),
        "inertia": inertia,
        "damping": damping,
        "coulomb": coulomb,
        "torque_constant": gain * constant,
        "current_bandwidth": 1.0 / (math.tau * loop),
        "current_period": period,
        "delay": lag - 0.5 * period - loop,
        "noise_seed": seed,
        "probe_torque": 0.0,  # it sticks with more than that
    }
    if seed % 4 == 3:
        damper = 2.0 * ratio * math.sqrt(stiffness * load)
        servo |= {"load_inertia": load, "transmission_stiffness": stiffness}
        servo |= {"transmission_damping": damper, "inertia": inertia - load, "backlash": 0.0}
    sets = [f"servo.{name}={value}" for name, value in servo.items()]
    return load_config("emulated-xm430", ["loop.clock=simulated", "wall.side=both", *sets]).config


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
    assert keeps(case)


def keeps(case: Case) -> bool:
    """Whether the identified servo gets as much stiffness as before."""
    return all(b >= 0.9999 * a for a, b in zip(case.before, case.after, strict=True))


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


@pytest.mark.whole
def test_servos_inside_the_belief_lose_no_stiffness(
    thorough: bool, record_property: Callable[[str, object], None]
) -> None:
    cases = [case_of(believed_servo(seed)) for seed in range(40 if thorough else 1)]
    missed = {seed: case.holds for seed, case in enumerate(cases) if not all(case.holds.values())}
    record_property("seeds whose bounds do not hold", str(missed))
    known = np.array([[a / b for a, b in zip(c.after, c.known, strict=True)] for c in cases])
    lost = [seed for seed, case in enumerate(cases) if not keeps(case)]
    record_property("seeds that lost stiffness", str(lost))
    record_property("share of the known servo's", np.median(known, axis=0).round(3).tolist())
    assert not lost
    assert len(missed) <= len(cases) // 40, missed  # they hold jointly in 99 %
    # Little is lost by not knowing better: what a known servo gets is in decisions/guard-limits.md.
    assert np.all(np.median(known, axis=0) > 0.6)
