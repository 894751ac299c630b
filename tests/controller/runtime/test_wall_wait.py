"""The message about a wall that does not come on: where the shaft is, where it must go."""

import math
from types import SimpleNamespace
from typing import Any

from haptic_wall.controller.laws.engagement import Engagement
from haptic_wall.controller.laws.wall import Side, Wall
from haptic_wall.controller.runtime.wall_wait import sign_text, waiting_text


def waiting(
    stiffness: float,
    surface: float,
    side: Side,
    position: float,
    *,
    limit: float = 4.1,
    sign: int = 1,
    offset: float = 0.0,
) -> tuple[Any, Any]:
    """An axis whose wall waits, and its configuration."""
    schedule = SimpleNamespace(allowed=SimpleNamespace(stiffness=stiffness))
    axis = SimpleNamespace(
        law=Wall(stiffness, 0.0, surface, side),
        position=position,
        torque_limit=limit,
        gains=SimpleNamespace(schedule=schedule),
        engagement=Engagement(0.1, math.tau / 4096, 50),
    )
    wall, servo = SimpleNamespace(acting_side=side), SimpleNamespace(sign=sign, offset=offset)
    return axis, SimpleNamespace(wall=wall, servo=servo)


def test_the_text_says_where_the_shaft_is_and_where_it_must_go() -> None:
    assert waiting_text(*waiting(8.0, 0.0, "both", 18.8)) == (
        "at 1077.2° (2.99 turns) the wall (both) would push with up to 4.1 N·m; it comes on when "
        "that has stayed below 0.1 N·m for 50 ms: turn the shaft to within 0.72° of 0.0° (0.00 "
        "turns)"
    )
    below = waiting_text(*waiting(8.0, -6.3, "below", -12.6, limit=99.0))
    assert "would push with up to 50.4 N·m" in below
    assert "turn the shaft above -361.0° (-1.00 turns)" in below
    for position, torque in ((0.05, "0.06"), (-0.1, "0")):
        stays = waiting_text(*waiting(1.2, 0.0, "above", position, limit=0.5))
        assert f"up to {torque} N·m" in stays
        assert stays.endswith("below 0.1 N·m for 50 ms"), "it needs no turn"


def test_a_sign_that_alone_puts_the_shaft_outside_is_doubted() -> None:
    def doubted(position: float, sign: int = 1, offset: float = 0.0) -> str:
        return sign_text(*waiting(10.0, 3.0, "below", position, sign=sign, offset=offset))

    assert doubted(-3.1) == (
        "; or the sign of the servo is wrong: with servo.sign=-1 the shaft would be at 177.6° (0.49"
        " turns), where the wall may come on"
    )
    assert "servo.sign=1 the shaft would be at 194.8°" in doubted(-3.1, -1, 0.15)
    assert doubted(2.6, offset=4.0) == "", "not far inside"
    assert doubted(-2.9) == "", "inside with either sign"
