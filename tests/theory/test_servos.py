"""The identified servos, with the numbers that their source gives."""

from __future__ import annotations

import pytest

from haptic_wall.controller.theory import linear_limit
from haptic_wall.controller.theory.servos import SERVOS


@pytest.mark.parametrize(
    ("name", "limits"),
    [("MX-64", (23.4, 7.79, 4.68, 2.13)), ("XL330-M288", (7.32, 2.44, 1.46, 0.67))],
)
def test_limits_published_for_them_follow(name: str, limits: tuple[float, ...]) -> None:
    found = linear_limit(SERVOS[name].damping, 0.0, 1e-3, [0.0, 1e-3, 2e-3, 5e-3])
    assert found == pytest.approx(limits, rel=0.007)  # two or three digits are given
