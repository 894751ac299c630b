"""Lists the laws, and makes a law from its configured numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from haptic_wall.controller.laws import detents, friction, own, profile, stops, texture
from haptic_wall.controller.laws.several import Sum
from haptic_wall.controller.laws.shape import Grid, LawError, Numbers, Shape
from haptic_wall.controller.laws.shaped import ShapedLaw
from haptic_wall.controller.laws.wall import NONE, Law, Side, Wall


@dataclass(frozen=True, slots=True)
class Kind:
    """A law that comes with the program."""

    meaning: str
    """Description of how it feels, for messages"""
    numbers: tuple[str, ...]
    """Names of its numbers in the configuration"""
    make: Callable[..., Shape]
    """Called with the grid, and the numbers by name"""
    example: Mapping[str, Any]
    """Numbers with which it acts between -0.8 and 0.8 rad, for pictures and tests"""
    needed: Mapping[str, str] = field(default_factory=dict)
    """Meaning of each number without which there is no such law, for messages"""


SUM: Final = "sum"
LAWS: Final[dict[str, Kind]] = {
    "wall": Kind("a wall at a position", ("side",), stops.wall, {}),
    "stops": Kind(
        "a wall at each end of a free range",
        ("low", "high"),
        stops.make,
        {"low": -0.5, "high": 0.3},
        dict.fromkeys(("low", "high"), "the position of this end [rad]"),
    ),
    "spring": Kind("a spring to a centre", (), stops.spring, {}),
    "damper": Kind("viscous friction", (), stops.damper, {}),
    "detents": Kind(
        "positions that hold the shaft",
        ("count", "width", "snap"),
        detents.make,
        {"count": 24, "snap": 0.4},
    ),
    "friction": Kind(
        "friction that sticks and slips",
        ("friction",),
        friction.make,
        {"friction": 0.1},
        {"friction": "the torque at which it slips [N·m] above 0"},
    ),
    "texture": Kind(
        "a grating",
        ("period",),
        texture.make,
        {"period": 0.1},
        {"period": "the grating's period [rad]"},
    ),
    "profile": Kind(
        "torque over position from a table",
        ("profile",),
        profile.make,
        {"profile": ((-0.8, 1.5), (-0.4, 2.0), (-0.1, 0.0), (0.1, 0.0), (0.6, -2.5))},
        {"profile": "a list of [position, torque] [rad, N·m]"},
    ),
}
"""Every law by its name in ``wall.law``, besides ``sum`` and those of users"""
EXAMPLES: Final[dict[str, Mapping[str, Any]]] = {
    **{name: kind.example for name, kind in LAWS.items()},
    SUM: {
        "parts": (
            {"law": "detents", "width": 0.2, "snap": 0.1},
            {"law": "stops", "low": -0.6, "high": 0.6, "share": 3.0},
        )
    },
}
"""Numbers of each law that comes with the program"""


def names() -> list[str]:
    """Return the names that ``wall.law`` takes besides ``module:Class``."""
    ours = [*LAWS, SUM, NONE]
    return [*ours, *(each for each in own.registered() if each not in ours)]


def shape_of(numbers: Numbers, grid: Grid) -> Shape:
    """Return the shape of a law.

    Args:
        numbers: Name and numbers of the law.
        grid: Sampling period and encoder step.

    Raises:
        LawError: There is no such law, or its numbers make none.
    """
    name = numbers.law
    if name == NONE:
        return stops.damper(grid)
    if name == SUM:
        return _sum(numbers, grid)
    if name in LAWS:
        return _of_kind(LAWS[name], numbers, grid)
    if ":" not in name and name not in own.registered():
        raise LawError("law", f"found {name}", f"one of {', '.join(names())}, or module:Class")
    return own.own_table(name, numbers.options, grid)


def _of_kind(kind: Kind, numbers: Numbers, grid: Grid) -> Shape:
    given = {number: getattr(numbers, number) for number in kind.numbers}
    for number, wanted in kind.needed.items():
        if given[number] is None:
            raise LawError(number, "found nothing", wanted)
    return kind.make(grid, **given)


def _sum(numbers: Numbers, grid: Grid) -> Sum:
    made = []
    for place, part in enumerate(numbers.parts):
        if part.law in (SUM, NONE):
            wanted = "its parts in this list" if part.law == SUM else "no such part"
            raise LawError("parts", f"found a {part.law} in part {place}", wanted)
        try:
            made.append((part.law, shape_of(part, grid), part.share))
        except LawError as error:
            raise LawError(
                "parts", f"in part {place}, {part.law}.{error.field}: {error.found}", error.wanted
            ) from None
    if not made:
        raise LawError("parts", "found none", "a list of laws, each with its numbers and its share")
    return Sum(made)


def rendered_law(numbers: Numbers, grid: Grid, position: float, clip: float = math.inf) -> Law:
    """Return the law to render, with stiffness and damping 0.

    A wall, a spring, a damper and none are linear, and rendered by the quickest code.

    Args:
        numbers: Name and numbers of the law.
        grid: Sampling period and encoder step.
        position: Position from which its positions count [rad].
        clip: Largest torque [N·m].

    Raises:
        LawError: As for ``shape_of``.
    """
    if numbers.law in LINEAR:
        side: Side = numbers.side if numbers.law == "wall" else "both"
        wall = Wall(0.0, 0.0, position, side, clip)
        wall.name = numbers.law
        return wall
    return ShapedLaw(numbers.law, shape_of(numbers, grid), position, clip)


LINEAR: Final = ("wall", "spring", "damper", NONE)
"""Laws with one spring of one slope, perhaps 0"""
