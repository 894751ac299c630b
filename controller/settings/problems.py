"""Tells errors of a configuration's validation in words, one for each field."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

from pydantic import ValidationError

from haptic_wall.controller.settings.axes import OWN, RENAMED
from haptic_wall.controller.settings.axis_names import MOST_AXES, split_path
from haptic_wall.controller.settings.fields import fields, sections
from haptic_wall.controller.settings.rules import BrokenRulesError
from haptic_wall.hw.errors import Problem
from haptic_wall.hw.names import did_you_mean

_MOST_HINTS: Final = 20
"""Largest number of unknown keys with a suggestion: finding one takes time"""


def problems_of(error: ValidationError, data: dict[str, Any]) -> list[Problem]:
    """Return the library's errors in our words, one for each field."""
    found: dict[str, Problem] = {}
    for detail in error.errors():
        cause = detail.get("ctx", {}).get("error")
        if isinstance(cause, BrokenRulesError):
            given = (replace(each, field=_given(each.field or "", data)) for each in cause.problems)
            return list(dict.fromkeys(given))
        where = [str(step) for step in detail["loc"]] or [""]  # a name that is no Unicode has none
        prefix = ""
        if where[0] == "axes":
            if len(where) < 3 or where[2] == "[key]":
                path = ".".join(where[:2])
                found[path] = replace(_wrong_axis(where, data), field=path)
                continue
            prefix, where = f"axes.{where[1]}.", where[2:]
        if detail["type"] in ("extra_forbidden", "invalid_key"):
            path = _given(prefix + ".".join(where), data)
            hint = _known_instead(".".join(where), prefix) if len(found) < _MOST_HINTS else ""
            found.setdefault(path, Problem("unknown", advice=hint, field=path))
            continue
        bare = ".".join(where[:2])
        path = _given(prefix + bare, data)
        if path not in found:
            problem = Problem(detail["msg"])
            if bare in fields() or bare in sections():
                problem = _wrong(bare, value_at(data, path), str(cause or ""))
            found[path] = replace(problem, field=path)
    return list(found.values())


def _given(path: str, data: dict[str, Any]) -> str:
    """Return where a setting is given: at the top level if only there, as one of the bus if so."""
    prefix, bare = split_path(path)
    section, _, key = bare.partition(".")
    key = key.split(".")[0]
    sections = [value_at(data, each) for each in (prefix + section, section, "bus")]
    here, there, bus = (isinstance(each, dict) and key in each for each in sections)
    if section == "servo" and key in RENAMED and bus:
        return f"bus.{key}"
    return bare if there and not here else path


def _wrong_axis(where: list[str], data: dict[str, Any]) -> Problem:
    """Return the problem of an axis that is none, or of all of them."""
    if where[2:]:
        wanted = "small letters, digits and _, at most 24, first a letter, as an axis's name"
        return Problem(f"found {shown(where[1])}", wanted=wanted)
    wanted = f"a section with {', '.join(OWN)}"
    if not where[1:]:
        wanted = f"at most {MOST_AXES} names, each with {wanted}"
    return Problem(f"found {shown(value_at(data, '.'.join(where)))}", wanted=wanted)


def _wrong(path: str, value: Any, wanted: str) -> Problem:  # noqa: ANN401
    """Return the problem of a value; ``wanted``: as its validator says it, or empty."""
    field = fields().get(path)
    found = f"found {shown(value)}"
    if field is None:
        keys = ", ".join(sections()[path].model_fields)
        return Problem(found, wanted=f"a section with {keys}")
    unit = f" [{field.unit}]" if field.unit else ""
    hint = did_you_mean(value, field.choices) if isinstance(value, str) else ""
    return Problem(found, wanted=wanted or f"{field.wanted}{unit}", advice=hint)


def _known_instead(path: str, prefix: str) -> str:
    """Return advice on an unknown path: the nearest known one, or where all are listed."""
    known = [each for each in fields() if not prefix or each.split(".")[0] in OWN]
    homes = [each for each in known if each.endswith(f".{path.rsplit('.', maxsplit=1)[-1]}")]
    near = (
        f"did you mean {prefix}{homes[0]}?"
        if homes
        else did_you_mean(path, [*sections(), *known], prefix)
    )
    return near or "`haptic-wall config` lists all settings"


def shown(value: Any) -> str:  # noqa: ANN401
    """Format a found value, short enough for a line."""
    text = "null" if value is None else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def value_at(data: Any, path: str) -> Any:  # noqa: ANN401
    """Return what unchecked data have at a path; None: nothing."""
    for step in path.split("."):
        data = data.get(step) if isinstance(data, dict) else None
    return data
