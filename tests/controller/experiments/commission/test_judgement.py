"""The verdict against the guard itself; agreement where there is, and where there is none."""

from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.experiments.commission import agreement
from haptic_wall.controller.experiments.commission.verdict import GuardQuestion, verdict
from haptic_wall.controller.report import commission_text as words
from haptic_wall.controller.settings.load import load_config
from tests.cases import whole_only


def question(name: str = "simulated", *sets: str) -> GuardQuestion:
    return GuardQuestion.of(load_config(name, ["loop.clock=simulated", *sets]).config, None)


@pytest.mark.whole
@pytest.mark.parametrize(
    "sets",
    [
        (),
        whole_only(("delay.steps=4",)),
        whole_only(("servo.counts_per_rev=0", "delay.steps=2")),
        whole_only(("wall.side=both", "wall.velocity_samples=4")),
        ("servo.damping=0", "servo.counts_per_rev=512"),
    ],
)
def test_no_damping_allows_more_than_the_best(sets: tuple[str, ...], thorough: bool) -> None:
    asked = question("simulated", *sets)
    best = verdict(asked, True)["best"]["commanded"]
    # The guard itself, at many dampings; the best is given in three digits.
    highest = max(
        asked.decide(1e6, float(b)).stiffness
        for b in np.linspace(0.0, 3.0 * best["damping"] + 0.01, 150 if thorough else 25)
    )
    assert best["stiffness"] >= 0.99 * highest
    assert best["stiffness"] == asked.decide(1e6, best["damping"]).stiffness


def test_the_measured_age_makes_it_softer() -> None:
    config = load_config("emulated-ideal").config
    young, old = (
        verdict(GuardQuestion.of(config, age), True)["plain"]["commanded"] for age in (6e-4, 3e-3)
    )
    assert old["stiffness"] < 0.5 * young["stiffness"]


def swept(measured: float | None, **more: Any) -> dict[str, Any]:
    point = {
        "virtual_damping": 0.0,
        "delay_steps": 3,
        "delay_s": 0.003,
        "kick_rad": 0.1,
        "uncertainty": 0.03,
        "exact": 3.34,
        "reason": None,
    }
    return {**point, "measured": measured, **more}


def test_a_servo_that_oscillates_too_early_is_told_with_a_margin() -> None:
    config = load_config("simulated").config
    (expected,) = agreement.boundary(config, [swept(13.0)])
    assert expected["agree"] is True
    found = agreement.boundary(config, [swept(0.6 * expected["expected"]), swept(13.0)])
    assert [point["agree"] for point in found] == [False, True]
    said = " ".join(words._boundary(found, 0.8))
    assert "1 of 2" in said and "0.60 of the expected" in said
    margin = 0.8 * 0.6 * expected["expected"] / found[0]["low"]
    assert f"guard.margin to {margin:.2g}" in said and margin < 0.55


def test_backlash_that_is_believed_takes_no_margin() -> None:
    believed = ["servo.backlash=0.004", "model.backlash={value: 0.004, low: 0.003, high: 0.005}"]
    point = swept(13.0, kick_rad=0.02)
    (without,) = agreement.boundary(load_config("simulated").config, [point])
    (expected,) = agreement.boundary(load_config("simulated", believed).config, [point])
    assert expected["expected"] < 0.9 * without["expected"]
    found = agreement.boundary(
        load_config("simulated", believed).config, [swept(expected["expected"], kick_rad=0.02)]
    )
    assert "requires a lower guard.margin" in " ".join(words._boundary(found, 0.8))


@pytest.mark.parametrize("binding", ["backlash", "one_sided"])
def test_a_backlash_that_was_not_found_but_limits_has_a_remedy(binding: str) -> None:
    report = {
        "identify": {"torque_unit": "commanded", "warnings": [], "backlash": None},
        "verdict": {"best": {"binding": binding}, "model": {"coulomb": {"value": 0.0}}},
        "steps": [],
        "agreement": {"boundary": None},
    }
    said = " ".join(words.unknown(report))
    assert "No backlash between motor and shaft was found; a little may exist" in said
    assert ("set model.backlash if it is less" in said) == (binding == "backlash")


@pytest.mark.parametrize(("measured", "said"), [(33.0, True), (1.5, False), (None, False)])
def test_what_the_sweep_bore_with_friction_stands_beside_what_is_allowed(
    measured: float | None, said: bool
) -> None:
    points = [swept(9.0), swept(measured, delay_steps=0), swept(99.0, virtual_damping=0.1)]
    points = [{**each, "without_friction": 2.1} for each in points]
    decided = {"stiffness": 1.7, "damping": 0.0}, {"stiffness": 14.0, "damping": 0.1}
    verdict = dict(zip(("plain", "best"), ({"commanded": each} for each in decided), strict=True))
    headline = words.headline(
        {
            "name": "mine",
            "status": "complete",
            "agreement": {"boundary": points},
            "verdict": verdict,
        }
    )
    assert "and of 1.7 without." in headline
    assert ("Without it the sweep measured 33 with friction" in headline) == said
