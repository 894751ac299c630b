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
    problems: list[Problem] = []
    for change in sets:
        try:
            path = apply_set(data, change)
        except UserError as error:
            problems.append(error.problem)
        else:
            origins[".".join(path.split(".")[:2])] = "--set"
    config, found = _validated(data, {"runs": runs})
    problems += [_of_origin(problem, origins) for problem in found]
    if problems or config is None:
        raise ConfigError(title, problems)
    return Loaded(config, source, origins)


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
    problems.sort(key=lambda p: order.get(p.field or "", -1))
    return None, problems


def _problems(error: ValidationError, data: dict[str, Any]) -> list[Problem]:
    """Return the library's errors in our words, one for each field."""
    found: dict[str, Problem] = {}
    for detail in error.errors():
        cause = detail.get("ctx", {}).get("error")
        if isinstance(cause, BrokenRulesError):
            return cause.problems
        where = [str(step) for step in detail["loc"]]
        if detail["type"] in ("extra_forbidden", "invalid_key"):
            path = ".".join(where)
            hint = _known_instead(where) if len(found) < _MOST_HINTS else ""
            found[path] = Problem("unknown", advice=hint, field=path)
            continue
        path = ".".join(where[:2])
        if path not in found:
            problem = detail.get("ctx", {}).get(IN_WORDS)
            if path not in fields() and path not in sections():
                problem = Problem(detail["msg"])
            elif not isinstance(problem, Problem):
                problem = _wrong(path, _at(data, path), detail["type"])
            found[path] = replace(problem, field=path)
    return list(found.values())


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


def _known_instead(where: list[str]) -> str:
    """Return advice on an unknown key: the nearest known one, or what there is."""
    name, section = where[-1], sections().get(where[0])
    if where[:2] == ["wall", "parts"]:
        near = did_you_mean(name, Part.model_fields)
        return near or f"a part has {', '.join(Part.model_fields)}"
    if len(where) > 2:
        return "wanted value, low and high"
    if homes := [path for path in fields() if path.endswith(f".{name}")]:
        return f"did you mean {homes[0]}?"
    if section is None:
        return did_you_mean(name, sections()) or f"sections are {', '.join(sections())}"
    near = did_you_mean(name, section.model_fields, f"{where[0]}.")
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
    return [
        f"{section}.{key}"
        for section, content in data.items()
        if isinstance(content, dict)
        for key in content
    ]


def _at(data: Any, path: str) -> Any:  # noqa: ANN401
    for step in path.split("."):
        data = data.get(step) if isinstance(data, dict) else None
    return data
