"""Applies changes to the configuration of a running wall; lists changeable settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.fields import fields
from haptic_wall.controller.settings.load import apply_set, begin_law, loaded
from haptic_wall.controller.settings.model import NUMBERS
from haptic_wall.controller.system.printable import in_line
from haptic_wall.hw.names import did_you_mean

CHANGEABLE: Final = (
    "wall.stiffness",
    "wall.damping",
    "wall.position",
    "delay.steps",
    *(f"wall.{name}" for name in NUMBERS),
)
"""Paths that can be changed while a wall runs"""


def changed(config: Config, sets: Sequence[str]) -> Config:
    """Return the configuration with changes applied, checked like a configuration file.

    If the law changes, all of its numbers that are not in ``sets`` get their defaults.

    Args:
        config: Present configuration.
        sets: Changes as ``PATH=VALUE``.

    Raises:
        ConfigError: The changed configuration is invalid; the error lists every problem.
        UserError: A change is not of the form ``PATH=VALUE``, or its path cannot be changed during
            a run.
    """
    if not sets:
        raise UserError("found no change", field="set", wanted="PATH=VALUE")
    given: dict[str, Any] = {}
    for change in sets:
        _refuse_fixed(apply_set(given, change))
    wall = given.get("wall") or {}
    data = config.model_dump()
    if "law" in wall and wall["law"] != config.wall.law:
        begin_law(data["wall"])
    for section in ("wall", "delay"):
        data[section] |= given.get(section) or {}
    new = loaded(data, "of the running wall")
    new.request()  # refuses a law of the user that the run has not imported
    return new


def difference(old: Config, new: Config) -> Mapping[str, Any]:
    """Return the paths of the settings that differ, with the new values in JSON types."""
    before, after = (config.model_dump(mode="json") for config in (old, new))
    return {
        path: after[section][name]
        for path in CHANGEABLE
        for section, name in [path.split(".")]
        if before[section][name] != after[section][name]
    }


def with_changes(config: Config, new: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings after a change, as ``difference`` gives it; other paths do not count."""
    data = config.model_dump(mode="json")
    for path, value in new.items():
        if path in CHANGEABLE:
            section, _, name = path.partition(".")
            data[section][name] = value
    return data


def moved(old: Config, new: Config) -> bool:
    """Whether law or position differ, so that the torque changes by more than a factor."""
    names = (*NUMBERS, "position")
    return any(getattr(old.wall, name) != getattr(new.wall, name) for name in names)


def _refuse_fixed(path: str) -> None:
    if path in CHANGEABLE:
        return
    wanted = "wall.stiffness, wall.damping, wall.position, delay.steps, wall.law or its numbers"
    hint = "end the run, and start it with --set"
    if path not in fields():
        hint = did_you_mean(path, CHANGEABLE)
    what = "found a setting that a running wall cannot change"
    raise UserError(what, wanted=wanted, advice=hint, field=in_line(path))
