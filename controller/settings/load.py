"""Loads a configuration from a preset or a file and ``--set``; reports all errors at once."""

from __future__ import annotations

import copy
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from haptic_wall.controller.errors import ConfigError, UserError
from haptic_wall.controller.laws.table import LAWS, SUM
from haptic_wall.controller.laws.wall import NONE
from haptic_wall.controller.settings import yaml_text as config_yaml
from haptic_wall.controller.settings.axes import RENAMED
from haptic_wall.controller.settings.axis_names import split_path
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.fields import fields, sections
from haptic_wall.controller.settings.model import NUMBERS, Wall
from haptic_wall.controller.settings.problems import problems_of, shown, value_at
from haptic_wall.controller.system import files
from haptic_wall.controller.system.printable import in_line
from haptic_wall.hw.errors import Problem
from haptic_wall.hw.names import did_you_mean

DEFAULT_PRESET = "simulated"
MOST_BYTES = 2**16
"""Largest size of a configuration; this much of the worst YAML takes a second or two."""


@dataclass(frozen=True, slots=True)
class Loaded:
    """A configuration and its origin."""

    config: Config
    name: str
    """The preset's name or the file's path."""
    given: Collection[str]
    """Paths of the fields that preset, file or ``--set`` give; the others have their defaults"""
    axis: str = ""
    """The axis that the configuration is of; empty: it is whole"""
    whole: Config | None = None
    """With the other axes, where it is of one"""


def preset_names() -> list[str]:
    """Return the names of the program's presets, sorted."""
    return sorted(
        entry.name.removesuffix(".yaml")
        for entry in _presets().iterdir()
        if entry.name.endswith(".yaml")
    )


def preset_text(name: str) -> str:
    """Return the text of a preset's file."""
    return _presets().joinpath(f"{name}.yaml").read_text(encoding="utf-8")


def preset_summary(name: str) -> str:
    """Return the purpose of a preset: the first line of its file."""
    return preset_text(name).splitlines()[0].lstrip("# ")


def file_of(source: str) -> Path | None:
    """Return the file that a CONFIG names; None: it names a preset."""
    return None if source in preset_names() else Path(source)


def load_config(source: str, sets: Sequence[str] = (), *, runs: bool = False) -> Loaded:
    """Read, change and check a configuration.

    Args:
        source: A preset's name, or the path of a YAML file.
        sets: Changes as ``PATH=VALUE``, applied in order before anything is checked.
        runs: It is run: a law of the user's own is imported and checked too, see ``laws.own``.

    Raises:
        ConfigError: With every problem found.
        UserError: There is no such preset or file, or it cannot be read.
    """
    data, title = _read(source)
    data = {} if data is None else data
    if not isinstance(data, dict):
        raise ConfigError(
            title,
            [Problem(f"found {shown(data)}", wanted="sections such as wall: and servo:")],
        )
    problems: list[Problem] = []
    paths = [change.partition("=")[0].strip() for change in sets]
    for path, change in zip(paths, sets, strict=True):
        before = _law(data, path)
        try:
            apply_set(data, change)
        except UserError as error:
            problems.append(error.problem)
        else:
            if split_path(path)[1] == "wall.law" and _law(data, path) not in (before, NONE):
                wall = path.removesuffix(".law")
                begin_law(value_at(data, wall), {each.removeprefix(f"{wall}.") for each in paths})
    config, found = _validated(data, {"runs": runs})
    problems += found
    given = _leaves(data)
    if config is not None:
        problems += _of_another_law(config, given)
    if problems or config is None:
        raise ConfigError(title, problems)
    return Loaded(config, source, given)


def _law(data: dict[str, Any], path: str) -> Any:  # noqa: ANN401 - whatever the file holds
    """Return the law at a path ``wall.law``, of an axis by default that of all."""
    laws = (value_at(data, each) for each in (path, split_path(path)[1]))
    return next(filter(None, laws), "wall")


def begin_law(wall: dict[str, Any], kept: Collection[str] = ()) -> None:
    """Drop the numbers of the law before from unchecked settings; those ``kept`` are of the new."""
    for name in NUMBERS:
        if name != "law" and name not in kept:
            wall.pop(name, None)


def _of_another_law(config: Config, given: Collection[str]) -> Iterator[Problem]:
    """Yield the given numbers of a wall that its law does not use."""
    uses = {name: kind.numbers for name, kind in LAWS.items()} | {SUM: ("parts",)}
    for path in given:
        prefix, bare = split_path(path)
        name = bare.removeprefix("wall.")
        if not bare.startswith("wall.") or name not in NUMBERS or name in ("law", "side"):
            continue
        walls = [one.wall for axis, one in config.each.items() if prefix in ("", f"axes.{axis}.")]
        default = Wall.model_fields[name].default
        is_used = any(
            wall.law == NONE
            or name in uses.get(wall.law, ("options",))
            or getattr(wall, name) == default
            for wall in walls
        )
        if not is_used:
            laws = [law for law, numbers in uses.items() if name in numbers]
            yield Problem(
                f"found a value, which the law {walls[0].law} does not use",
                field=in_line(path),
                advice=f"it is for wall.law {' or '.join(laws) or 'module:Class'}",
            )


def load_axis(
    source: str, sets: Sequence[str] = (), axis: str | None = None, *, runs: bool = False
) -> Loaded:
    """Load a configuration for a command that works on one servo; see ``load_config``.

    Args:
        source: A preset's name, or the path of a YAML file.
        sets: Changes as ``PATH=VALUE``.
        axis: Name of the axis, which is then alone; None: there is only one.
        runs: It is run.

    Raises:
        ConfigError: With every problem found.
        UserError: It cannot be read, or has no such axis, or several and none is named.
    """
    found = load_config(source, sets, runs=runs)
    each = found.config.each
    if axis is None and len(each) == 1:
        (axis,) = each
    if axis not in each:
        names = ", ".join(filter(None, each))
        what = "found no name" if axis is None else f"found {in_line(axis)}"
        wanted = f"one of {names}: this command works on one servo"
        if not names:
            wanted = "no axis: the configuration has no axes"
        hint = did_you_mean(axis or "", each)
        raise UserError(what, field="--axis", wanted=wanted, advice=hint)
    name = f"{source}:{axis}" if axis else source
    return replace(found, config=each[axis], name=name, axis=axis, whole=found.config)


def apply_set(data: dict[str, Any], change: str) -> str:
    """Apply one ``PATH=VALUE`` to unchecked data, in place; the value is read as YAML.

    Returns:
        The path.

    Raises:
        UserError: It is not of that form, is of a whole section or of an axis that is not there, or
            leads through something that is no section.
    """
    path, equals, text = change.partition("=")
    path = path.strip()
    steps = path.split(".")
    given = in_line(change)
    if not equals or not all(steps):
        raise UserError(
            "wanted PATH=VALUE, e.g. --set wall.stiffness=20", field="--set", given=given
        )
    axis, own = split_path(path)
    if own in sections():
        advice = "give one setting, such as wall.stiffness=20"
        raise UserError("found a whole section", field="--set", given=given, advice=advice)
    axes = data.get("axes") or {}
    if axis and isinstance(axes, dict) and axis[5:-1] not in axes:
        near = did_you_mean(axis[5:-1], axes) or f"axes are {', '.join(axes) or 'none'}"
        raise UserError("no such axis", field=in_line(axis[:-1]), advice=near)
    value = config_yaml.parse(text, given, field="--set")
    place = data
    for depth, step in enumerate(steps[:-1], start=1):
        inner = place.setdefault(step, {})
        if inner is None:
            inner = place[step] = {}
        if not isinstance(inner, dict):
            raise UserError(
                f"{'.'.join(steps[:depth])} is {shown(inner)} and has no {steps[depth]}",
                field="--set",
                given=given,
                advice=f"to give bounds set {'.'.join(steps[:depth])}={{value: V, low: L, high: "
                "H}",
            )
        place = inner
    place[steps[-1]] = value
    other = data.get("bus")
    if steps[0] == "servo" and steps[-1] in RENAMED and isinstance(other, dict):
        other.pop(steps[-1], None)  # the other name of the same setting
    return path


def _presets() -> resources.abc.Traversable:
    return resources.files("haptic_wall.controller").joinpath("presets")


@lru_cache
def _preset_data(name: str) -> Any:  # noqa: ANN401 - whatever the file holds
    """Return the unchecked data of a preset, read once: YAML takes longer than all the rest."""
    return config_yaml.parse(preset_text(name), f"preset {name}")


def _read(source: str) -> tuple[Any, str]:
    """Return the unchecked data of a preset or file, and its title for messages."""
    if source in preset_names():
        return copy.deepcopy(_preset_data(source)), f"preset {source}"
    path = Path(source)
    try:
        text = files.content(path, MOST_BYTES).decode("utf-8")
    except FileNotFoundError:
        near = did_you_mean(source, preset_names())
        raise UserError(
            "; ".join(filter(None, ("no such preset or file", near))),
            field="CONFIG",
            given=source,
            advice=f"presets are {', '.join(preset_names())}",
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise UserError(
            f"cannot be read: {reason}", field="CONFIG", given=source, advice="wanted a YAML file"
        ) from None
    return config_yaml.parse(text, str(path)), str(path)


def loaded(data: dict[str, Any], title: str) -> Config:
    """Return the checked configuration of settings that were not read from a file.

    Args:
        data: Settings by section and name.
        title: Their source, for messages.

    Raises:
        ConfigError: With every problem found.
    """
    config, problems = _validated(data)
    if config is None:
        raise ConfigError(title, problems)
    return config


def _validated(
    data: dict[str, Any], context: dict[str, Any] | None = None
) -> tuple[Config | None, list[Problem]]:
    """Return the configuration, or all of its problems."""
    try:
        return Config.model_validate(data, context=context), []
    except ValidationError as error:
        found = problems_of(error, data)
    problems = [replace(each, field=in_line(each.field or "")) for each in found]
    order = {path: place for place, path in enumerate(fields())}
    problems.sort(key=lambda p: order.get(split_path(p.field or "")[1], -1))
    return None, problems


def _leaves(data: dict[str, Any]) -> list[str]:
    """Return the paths of the given fields."""
    axes = data.get("axes")
    parts = {"": data}
    if isinstance(axes, dict):
        parts |= {f"axes.{name}.": axis for name, axis in axes.items() if isinstance(axis, dict)}
    return [
        f"{prefix}{section}.{key}"
        for prefix, part in parts.items()
        for section, content in part.items()
        if isinstance(content, dict) and section != "axes"
        for key in content
    ]
