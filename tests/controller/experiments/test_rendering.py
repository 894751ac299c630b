"""The comparison says of a simulated servo what it is, within the standard errors it gives."""

from pathlib import Path

import pytest

from haptic_wall.controller.experiments.rendered.contact_transient import plan_approach
from haptic_wall.controller.experiments.rendered.rendering import (
    Rendering,
    measure_rendering,
)
from haptic_wall.controller.experiments.rendered.rows import Comparison
from haptic_wall.controller.experiments.rendered.static_stiffness import plan_push
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory import restitution
from tests.typed import not_none


def measured(folder: Path, *sets: str) -> tuple[Rendering, dict[str, Comparison]]:
    config = load_config("simulated", ("loop.clock=simulated", *sets)).config
    found = measure_rendering(config, folder)
    return found, {row.name: row for row in found.rows}


def within(row: Comparison, truth: float, times: float = 3.0) -> None:
    assert row.rendered == pytest.approx(truth, abs=times * not_none(row.stderr))


@pytest.fixture(scope="module")
def usual(
    whole_experiment: None,  # noqa: ARG001 - leaves it out
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Rendering, dict[str, Comparison]]:
    return measured(tmp_path_factory.mktemp("usual"), "servo.delay=0.001")


@pytest.fixture(scope="module")
def other(
    whole_experiment: None,  # noqa: ARG001 - leaves it out
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Rendering, dict[str, Comparison]]:
    """Believed a third heavier than it is; with play, a wall on the other side, delay inserted."""
    return measured(
        tmp_path_factory.mktemp("other"),
        "servo.delay=0.001",
        "delay.steps=2",
        "servo.backlash=0.004",
        "wall.side=below",
        "wall.stiffness=4",
        "model.inertia={value: 0.016, low: 0.011, high: 0.02}",
    )


def test_the_commanded_stiffness_is_rendered(
    usual: tuple[Rendering, dict[str, Comparison]],
) -> None:
    _, rows = usual
    row = rows["static stiffness"]
    assert row.commanded == 8.0
    within(row, 8.0)
    assert not_none(row.stderr) < 0.03
    within(rows["static stiffness, true"], 8.0)
    assert rows["static stiffness, true"].ratio == pytest.approx(1.0, abs=0.01)


def test_friction_delay_and_gain_are_the_servos(
    usual: tuple[Rendering, dict[str, Comparison]],
) -> None:
    _, rows = usual
    within(rows["drag, Coulomb"], 0.09039)
    within(rows["drag, viscous"], 0.011692)
    assert not_none(rows["drag, viscous"].stderr) < 0.05 * 0.011692
    within(rows["torque gain"], 1.0)
    within(rows["delay"], 0.001)
    assert rows["backlash"].rendered == 0.0


def test_contacts_are_those_of_a_simulated_servo(
    usual: tuple[Rendering, dict[str, Comparison]],
) -> None:
    found, rows = usual
    fast = [row for name, row in rows.items() if name.startswith("exit/entry") and row.rendered]
    assert fast
    assert len(found.contacts) == 10
    # With friction no contact returns more than the worst one without.
    worst = float(restitution(0.011951, 0.011692, 8.0, 0.02, 1e-3, 1e-3))
    for row in fast:
        assert not_none(row.rendered) < worst
        assert row.rendered == pytest.approx(row.commanded, abs=0.05 + 3 * not_none(row.stderr))
    for name, row in rows.items():
        if name.startswith(("penetration", "peak torque")):
            assert row.ratio == pytest.approx(1.0, abs=0.05), name


def test_a_wrong_belief_shows_in_true_units_only(
    other: tuple[Rendering, dict[str, Comparison]],
) -> None:
    found, rows = other
    assert found.stiffness == 4.0
    within(rows["static stiffness"], 4.0)
    gain = 0.016 / 0.011951
    within(rows["torque gain"], gain)
    within(rows["static stiffness, true"], 4.0 * gain)


def test_play_and_inserted_delay_show(other: tuple[Rendering, dict[str, Comparison]]) -> None:
    _, rows = other
    within(rows["backlash"], 0.004)
    within(rows["delay"], 0.003)


def test_plans_keep_within_travel_and_torque() -> None:
    push = not_none(plan_push(200.0, 0.1, 0.09, 4.1, 0.00153))
    assert push.torque <= 0.5 * 4.1
    assert plan_push(0.0, 0.1, 0.09, 4.1, 0.00153) is None
    approach = not_none(plan_approach(200.0, 0.1, 0.012, 4.1, 30.0, 1e-3))
    frequency = (200.0 / 0.012) ** 0.5
    deepest = max(approach.speeds) / frequency
    assert 200.0 * deepest < 0.5 * 4.1
    assert plan_approach(0.0, 0.1, 0.012, 4.1, 30.0, 1e-3) is None
