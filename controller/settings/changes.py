"""Changes of a running wall: which settings can be changed, and the configuration with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.fields import fields
from haptic_wall.controller.settings.load import apply_set, loaded
from haptic_wall.controller.settings.model import LawNumbers
from haptic_wall.controller.system.printable import in_line
from haptic_wall.hw.errors import Problem
from haptic_wall.hw.names import did_you_mean

_NUMBERS: Final = (*LawNumbers.model_fields, "parts")
"""Fields of ``wall`` that say which law it is"""
CHANGEABLE: Final = (
    "wall.stiffness",
    "wall.damping",
    "wall.position",
    "delay.steps",
    *(f"wall.{name}" for name in _NUMBERS),
)
"""Paths that can be changed while a wall runs"""


def changed(config: Config, sets: Sequence[str]) -> Config:
    """Return the configuration of a running wall with changes, by the rules of a file.

    Another law begins with the usual numbers, except for those in ``sets``.

    Args:
        config: In force now.
        sets: Changes as ``PATH=VALUE``.

    Raises:
        ConfigError: With every problem found.
        UserError: A change is not of that form, or its path cannot be changed now.
    """
    if not sets:
        raise UserError("found no change", field="set", wanted="PATH=VALUE")
    given: dict[str, Any] = {}
    for change in sets:
        _refuse_fixed(apply_set(given, change))
    wall = given.get("wall") or {}
    data = config.model_dump()
    if "law" in wall and wall["law"] != config.wall.law:
        for name in _NUMBERS:
            del data["wall"][name]
    for section in ("wall", "delay"):
        data[section] |= given.get(section) or {}
    return loaded(data, "of the running wall")


def difference(old: Config, new: Config) -> Mapping[str, Any]:
    """Return the changed settings by path, with their new values as JSON holds them."""
    before, after = (config.model_dump(mode="json") for config in (old, new))
    return {
        path: after[section][name]
        for path in CHANGEABLE
        for section, name in [path.split(".")]
        if before[section][name] != after[section][name]
    }


def moved(old: Config, new: Config) -> bool:
    """Whether the law is another one, or elsewhere: its torque changes by more than a factor."""
    names = (*_NUMBERS, "position")
    return any(getattr(old.wall, name) != getattr(new.wall, name) for name in names)


def _refuse_fixed(path: str) -> None:
    if path in CHANGEABLE:
        return
    wanted = "wall.stiffness, wall.damping, wall.position, delay.steps, wall.law or its numbers"
    if path in fields():
        what = "found a setting that a running wall keeps"
        hint = "end the run, and start it with --set"
    else:
        what = "unknown"
        hint = did_you_mean(path, CHANGEABLE) or did_you_mean(path, fields())
    raise UserError(Problem(what, wanted=wanted, advice=hint, field=in_line(path)))
