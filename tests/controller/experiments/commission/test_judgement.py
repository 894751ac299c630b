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


def agreed(points: list[dict[str, Any]]) -> str:
    report = {"agreement": {"boundary": points}, "verdict": {"margin": 0.8}}
    return " ".join(words.agrees(report))


def test_a_servo_that_oscillates_too_early_is_told_with_a_margin() -> None:
    config = load_config("simulated").config
    (expected,) = agreement.boundary(config, [swept(13.0)])
    assert expected["agree"] is True
    found = agreement.boundary(config, [swept(0.6 * expected["expected"]), swept(13.0)])
    assert [point["agree"] for point in found] == [False, True]
    said = agreed(found)
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
    assert agreed(found) == "1 of 1 measured points agree with the model"
