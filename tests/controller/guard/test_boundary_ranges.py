"""``haptic-wall boundary`` over what is not known: quick, or refused in a sentence."""

import pytest

from haptic_wall.controller.cli.main import main

LOOP = ("--rate=1000", "--delay=0.002", "--virtual-damping=0.005")


@pytest.mark.parametrize(
    "words",
    [
        ("--inertia=1e-9:1e9", "--damping=0.01"),
        ("--inertia=0.01", "--damping=1e-9:1e9"),
        ("--servo=MX-64", "--torque-gain=1e-9:1e9"),
    ],
)
def test_a_range_of_many_decades_is_refused(
    words: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["boundary", *LOOP, *words]) == 2
    told = capsys.readouterr().err
    assert "1e-09:1e+09" in told and "wanted at most 10000 times" in told


def test_a_damping_from_nothing_on_is_no_range_of_many_decades(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["boundary", *LOOP, "--inertia=0.01", "--damping=0:0.01"]) == 0
    assert capsys.readouterr().err == ""
