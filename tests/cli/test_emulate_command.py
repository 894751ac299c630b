"""What the emulate command makes of its options, and what it says of wrong ones."""

import math
import os
from pathlib import Path

import pytest

from haptic_wall.controller.emulated_bus.program import DEFAULT_TRUTH, truth_of
from haptic_wall.hw.dynamixel.tables import MODELS
from tests.cli.caller import Cli


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--servo", "XM430-W35"], ["XM430-W35", "did you mean XM430-W350"]),
        (["--servo", "XM430-W350:" + 5000 * "9"], ["MODEL[:ID[:FIRMWARE]]"]),
        (["--servo", "XM430-W350:253"], ["--servo: id 253", "252"]),
        (["--baud", "12345"], ["--baud: found 12345", "57600"]),
        (["--servo", "XM430-W350:1:300"], ["firmware_version 300", "255"]),
        (["--servo", "XD540-T270"], ["XD540-T270", "servo.torque_constant"]),
        (["--baud", "fast"], ["--baud", "fast"]),
        (["--baud", "12345"], ["12345", "4000000"]),
        (["--servo", "XL330-M288", "--baud", "4500000"], ["baud_rate", "XL330-M288"]),
        (["--set", "servo.inertai=1"], ["servo.inertai", "did you mean servo.inertia"]),
        (["--set", "servo.inertia"], ["servo.inertia", "VALUE"]),
        (["--set", "servo.inertia=0"], ["servo.inertia", "'0'", "from 1e-08"]),
        (["--set", "servo.counts_per_rev=1.5"], ["servo.counts_per_rev", "whole"]),
        (["--set", "servo.hand=slap"], ["servo.hand", "push"]),
        (["--set", "servo.load_friction=1"], ["servo.load_friction", "to 0.9"]),
        (["--set", "servo.static_friction=0.05"], ["servo.static_friction", "servo.coulomb, 0.09"]),
        (["--set", "servo@.inertia=1"], ["servo@.inertia"]),
        (["--set", "servo@7.inertia=1"], ["--set", "no servo has the id 7"]),
        (["--set", "arm.length_3=1"], ["arm.length_3", "did you mean arm.length_"]),
        (["--set", "arm.length_1=0"], ["arm.length_1", "above 0"]),
        (["--set", "arm.mass_1=0.2"], ["--set", "found arm.mass_1", "add --arm planar"]),
        (["--arm", "planar"], ["arm.shape", "found 1 servo"]),
        (["--latency-timer", "1.5"], ["--latency-timer", "1.5", "up to 255"]),
        (["--latency-timer", "1", "--block", "0"], ["--block", "found 0", "from 1"]),
        (["--fault", "drp:p=0.1"], ["--fault", "'drp'", "did you mean drop?"]),
        (
            ["--fault", "unplug:at=2,id=7"],
            ["--fault", "unplug:at=2,id=7", "no servo", "ids here are 1"],
        ),
    ],
)
def test_wrong_input_is_named_and_ends_with_2(
    cli: Cli, arguments: list[str], words: list[str]
) -> None:
    message = cli.refused("emulate", *arguments)
    for word in words:
        assert word in message


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


def test_record_that_cannot_be_written_is_refused(cli: Cli) -> None:
    assert "--record" in cli.refused("emulate", "--record", "/proc/no/such/folder.csv")


def test_truth_is_what_was_set_and_the_models_limits_otherwise() -> None:
    true = truth_of(MODELS["XL330-M288"], {"inertia": 0.5, "hand": "push"})
    assert true.inertia == 0.5
    assert true.hand == "push"
    assert true.torque_limit == 0.52
    assert true.damping == DEFAULT_TRUTH.damping
    assert true.position == math.pi
