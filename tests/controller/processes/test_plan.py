"""Loop and emulated bus wait for each other where no other bus is in their time."""

from pathlib import Path

import pytest

from haptic_wall.controller.processes.plan import Plan
from haptic_wall.controller.settings.load import load_config


@pytest.mark.parametrize(
    ("preset", "sets", "elastic"),
    [
        ("emulated-xm430", [], True),
        ("emulated-ideal", ["realtime.profile=off"], True),
        ("emulated-xm430", ["realtime.profile=strict"], False),
        ("emulated-xm430", ["loop.clock=simulated"], False),
        ("simulated", [], False),
        ("emulated-port", ["servo.port=/dev/ttyX"], False),
        ("xm430-w350", ["realtime.profile=best-effort"], False),
    ],
)
def test_only_a_bus_of_ones_own_is_waited_for(preset: str, sets: list[str], elastic: bool) -> None:
    plan = Plan(load_config(preset, sets).config, None, Path("x"), {}, None)
    assert plan.elastic is elastic
