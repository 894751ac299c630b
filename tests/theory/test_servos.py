"""The identified servos: found by name, with the numbers that their source gives."""

from __future__ import annotations

import pytest

from haptic_wall.controller.theory import linear_limit
from haptic_wall.controller.theory.servos import SERVOS, servo, sister


@pytest.mark.parametrize("name", ["XL330-M288", "xl330-m288", "XL330M288", "xl-330-m288"])
def test_case_and_hyphens_make_no_difference(name: str) -> None:
    assert servo(name) is SERVOS["XL330-M288"]


def test_a_servo_that_nobody_identified_names_its_sister() -> None:
    assert servo("xm430w350") is None
    assert sister("xm430w350") == ("XM430-W350", "MX-64")
    assert sister("lathe") is None


@pytest.mark.parametrize(
    ("name", "limits"),
    [("MX-64", (23.4, 7.79, 4.68, 2.13)), ("XL330-M288", (7.32, 2.44, 1.46, 0.67))],
)
def test_limits_published_for_them_follow(name: str, limits: tuple[float, ...]) -> None:
    found = linear_limit(SERVOS[name].damping, 0.0, 1e-3, [0.0, 1e-3, 2e-3, 5e-3])
    assert found == pytest.approx(limits, rel=0.007)  # two or three digits are given
