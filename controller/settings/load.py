"""Loads a configuration from a preset or a file and ``--set``; reports all errors at once."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from haptic_wall.controller.errors import ConfigError, UserError
from haptic_wall.controller.settings import yaml_text as config_yaml
from haptic_wall.controller.settings.axes import MOST_AXES, OWN, RENAMED, split_path
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.fields import fields, sections
from haptic_wall.controller.settings.model import IN_WORDS, Part
from haptic_wall.controller.settings.rules import BrokenRulesError
from haptic_wall.controller.system import files
from haptic_wall.controller.system.printable import in_line
from haptic_wall.hw.errors import Problem
from haptic_wall.hw.names import did_you_mean

DEFAULT_PRESET = "simulated"
MOST_BYTES = 2**16
"""Largest size of a configuration; this much of the worst YAML takes a second or two."""
_MOST_HINTS = 20
"""Largest number of unknown keys with a suggestion: finding one takes time"""


@dataclass(frozen=True, slots=True)
class Loaded:
    """A configuration and its origin."""

    config: Config
    name: str
    """The preset's name or the file's path."""
    origins: Mapping[str, str]
    """Origin of each given field by path: the preset, the file or ``--set``. Other fields have
    their defaults."""
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
            [Problem(f"found {_shown(data)}", wanted="sections such as wall: and servo:")],
        )
    origins = dict.fromkeys(_leaves(data), title)
    axes = data.get("axes")
    known = list(axes) if isinstance(axes, dict) else []
    problems: list[Problem] = []
    for change in sets:
        try:
            path = apply_set(data, change)
        except UserError as error:
            problems.append(error.problem)
        else:
            known = [] if path == "axes" else known
            prefix, rest = split_path(path)
            origins[prefix + ".".join(rest.split(".")[:2])] = "--set"
            name = prefix[5:-1]
            if known and name and name not in known:
                near = did_you_mean(name, known) or f"axes are {', '.join(known)}"
                problems.append(Problem("no such axis", advice=near, field=prefix[:-1]))
            if rest in map("servo.{}".format, RENAMED) and isinstance(data.get("bus"), dict):
                data["bus"].pop(rest.partition(".")[2], None)  # the later one counts
    for name in RENAMED:
        if _at(data, f"bus.{name}") is not None:
            origins[f"servo.{name}"] = origins[f"bus.{name}"]
    config, found = _validated(data, {"runs": runs})
    problems += [_of_origin(problem, origins) for problem in found]
    if problems or config is None:
        raise ConfigError(title, problems)
    return Loaded(config, source, origins)


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
    alone = loaded(each[axis].model_dump(), f"{source}, axis {axis}") if axis else found.config
    return replace(found, config=alone, name=name, axis=axis, whole=found.config)


def apply_set(data: dict[str, Any], change: str) -> str:
    """Apply one ``PATH=VALUE`` to unchecked data, in place; the value is read as YAML.

    Returns:
        The path.

    Raises:
        UserError: It is not of that form, or leads through something that is no section.
    """
    path, equals, text = change.partition("=")
    path = path.strip()
    steps = path.split(".")
    given = in_line(change)
    if not equals or not all(steps):
        raise UserError(
            "wanted PATH=VALUE, e.g. --set wall.stiffness=20", field="--set", given=given
        )
    value = config_yaml.parse(text, given, field="--set")
    place = data
    for depth, step in enumerate(steps[:-1], start=1):
        inner = place.setdefault(step, {})
        if inner is None:
            inner = place[step] = {}
        if not isinstance(inner, dict):
            raise UserError(
                f"{'.'.join(steps[:depth])} is {_shown(inner)} and has no {steps[depth]}",
                field="--set",
                given=given,
                advice=f"to give bounds set {'.'.join(steps[:depth])}={{value: V, low: L, high: "
                "H}",
            )
        place = inner
    place[steps[-1]] = value
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


def loaded(data: dict[str, Any], title: str, *, files: bool = True) -> Config:
    """Return the checked configuration of settings that were not read from a file.

    Args:
        data: Settings by section and name.
        title: Their source, for messages.
        files: They may name other files.

    Raises:
        ConfigError: With every problem found.
    """
    config, problems = _validated(data, {"files": files})
    if config is None:
        raise ConfigError(title, problems)
    return config


def _validated(
    data: dict[str, Any], context: dict[str, Any]
) -> tuple[Config | None, list[Problem]]:
    """Return the configuration, or all of its problems."""
    try:
        return Config.model_validate(data, context=context), []
    except ValidationError as error:
        problems = _problems(error, data)
    order = {path: place for place, path in enumerate(fields())}
    problems.sort(key=lambda p: order.get(split_path(p.field or "")[1], -1))
    return None, problems


def _problems(error: ValidationError, data: dict[str, Any]) -> list[Problem]:
    """Return the library's errors in our words, one for each field."""
    found: dict[str, Problem] = {}
    for detail in error.errors():
        cause = detail.get("ctx", {}).get("error")
        if isinstance(cause, BrokenRulesError):
            given = (replace(each, field=_given(each.field or "", data)) for each in cause.problems)
            return list(dict.fromkeys(given))
        where = [str(step) for step in detail["loc"]]
        prefix = ""
        if where[0] == "axes":
            if len(where) < 3 or where[2] == "[key]":
                path = ".".join(where[:2])
                found[path] = replace(_wrong_axis(where, data), field=path)
                continue
            prefix, where = f"axes.{where[1]}.", where[2:]
        if detail["type"] in ("extra_forbidden", "invalid_key"):
            path = _given(prefix + ".".join(where), data)
            hint = _known_instead(where, prefix) if len(found) < _MOST_HINTS else ""
            found.setdefault(path, Problem("unknown", advice=hint, field=path))
            continue
        bare = ".".join(where[:2])
        path = _given(prefix + bare, data)
        if path not in found:
            problem = detail.get("ctx", {}).get(IN_WORDS)
            if bare not in fields() and bare not in sections():
                problem = Problem(detail["msg"])
            elif not isinstance(problem, Problem):
                problem = _wrong(bare, _at(data, path), detail["type"])
            found[path] = replace(problem, field=path)
    return list(found.values())


def _given(path: str, data: dict[str, Any]) -> str:
    """Return where a setting is given: at the top level if only there, as one of the bus if so."""
    prefix, bare = split_path(path)
    section, _, key = bare.partition(".")
    key = key.split(".")[0]
    sections = [_at(data, each) for each in (prefix + section, section, "bus")]
    here, there, bus = (isinstance(each, dict) and key in each for each in sections)
    if section == "servo" and key in RENAMED and bus:
        return f"bus.{key}"
    return bare if there and not here else path


def _wrong_axis(where: list[str], data: dict[str, Any]) -> Problem:
    """Return the problem of an axis that is none, or of all of them."""
    if where[2:]:
        wanted = "small letters, digits and _, at most 24, first a letter, as an axis's name"
        return Problem(f"found {_shown(where[1])}", wanted=wanted)
    wanted = f"a section with {', '.join(OWN)}"
    if not where[1:]:
        wanted = f"at most {MOST_AXES} names, each with {wanted}"
    return Problem(f"found {_shown(_at(data, '.'.join(where)))}", wanted=wanted)


def _wrong(path: str, value: Any, kind: str) -> Problem:  # noqa: ANN401
    field = fields().get(path)
    found = f"found {_shown(value)}"
    if field is None:
        keys = ", ".join(sections()[path].model_fields)
        return Problem(found, wanted=f"a section with {keys}")
    unit = f" [{field.unit}]" if field.unit else ""
    hint = did_you_mean(value, field.choices) if isinstance(value, str) else ""
    if kind == "value_error":
        return Problem(found, wanted="low <= value <= high")
    return Problem(found, wanted=f"{field.wanted}{unit}", advice=hint)


def _known_instead(where: list[str], prefix: str) -> str:
    """Return advice on an unknown key: the nearest known one, or what there is."""
    name, section = where[-1], sections().get(where[0])
    if section and prefix and where[0] not in OWN:
        return f"{name} is the same for all axes: set it at the top level"
    if where[:2] == ["wall", "parts"]:
        near = did_you_mean(name, Part.model_fields)
        return near or f"a part has {', '.join(Part.model_fields)}"
    if len(where) > 2:
        return "wanted value, low and high"
    known = OWN if prefix else sections()
    if homes := [
        path for path in fields() if path.endswith(f".{name}") and path.split(".")[0] in known
    ]:
        return f"did you mean {prefix}{homes[0]}?"
    if section is None:
        return did_you_mean(name, known) or f"sections are {', '.join(known)}"
    near = did_you_mean(name, section.model_fields, f"{prefix}{where[0]}.")
    return near or f"{where[0]} has {', '.join(section.model_fields)}"


def _of_origin(problem: Problem, origins: Mapping[str, str]) -> Problem:
    """Return the problem with the source of its field."""
    path = problem.field or ""
    origin = "(from --set)" if origins.get(path) == "--set" else ""
    return replace(problem, field=in_line(path), given=origin)


def _shown(value: Any) -> str:  # noqa: ANN401
    """Format a found value, short enough for a line."""
    text = "null" if value is None else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


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


def _at(data: Any, path: str) -> Any:  # noqa: ANN401
    for step in path.split("."):
        data = data.get(step) if isinstance(data, dict) else None
    return data
