"""What the emulate command makes of its options, and what it says of wrong ones."""

import math
import os
from pathlib import Path

from haptic_wall.controller.emulated_bus.program import DEFAULT_TRUTH, truth_of
from haptic_wall.hw.dynamixel.tables import MODELS
from tests.support.program import Cli


def test_link_replaces_no_link_of_somebody_elses_nor_of_a_bus_that_runs(
    cli: Cli, tmp_path: Path
) -> None:
    link = tmp_path / "bus"
    link.symlink_to("precious")
    assert "found a link to precious, which would be lost" in cli.refused(
        "emulate", "--link", str(link)
    )
    assert str(link.readlink()) == "precious"
    link.unlink()
    _, follower = os.openpty()
    link.symlink_to(os.ttyname(follower))
    assert "found a link to /dev/pts" in cli.refused("emulate", "--link", str(link))


def test_truth_is_what_was_set_and_the_models_limits_otherwise() -> None:
    true = truth_of(MODELS["XL330-M288"], {"inertia": 0.5, "hand": "push"})
    assert true.inertia == 0.5
    assert true.hand == "push"
    assert true.torque_limit == 0.52
    assert true.damping == DEFAULT_TRUTH.damping
    assert true.position == math.pi
