"""Lists every setting with path, unit, range and meaning, from its declaration."""

from __future__ import annotations

import types
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.model import Estimate, Section
from haptic_wall.controller.settings.servo import used_by

_KIND_NAMES = {
    bool: "true or false",
    float: "a number",
    int: "a whole number",
    str: "a text",
    dict: "a section",
}


@dataclass(frozen=True, slots=True)
class Field:
    """One field of the configuration, for people."""

    path: str
    unit: str
    """Empty where there is none."""
    wanted: str
    """Accepted values in words: type, range or choices."""
    meaning: str
    choices: tuple[str, ...]
    """Accepted names; empty unless it takes names."""
    used_by: tuple[str, ...]
    """Kinds of servo that use it."""


@cache
def fields() -> dict[str, Field]:
    """Return every field by its path, in the order of declaration; not to be changed."""
    return {field.path: field for field in _walk()}


def sections() -> dict[str, type[Section]]:
    """Return the sections by name, in the order of declaration."""
    return {
        name: info.annotation
        for name, info in Config.model_fields.items()
        if isinstance(info.annotation, type) and issubclass(info.annotation, Section)
    }


def _walk() -> Iterator[Field]:
    for name, section in sections().items():
        for key, info in section.model_fields.items():
            extra = info.json_schema_extra if isinstance(info.json_schema_extra, dict) else {}
            options, nullable = _split(info.annotation)
            names = tuple(c for c in get_args(options) if isinstance(c, str))
            wanted = str(extra.get("wanted") or _wanted(options, info))
            yield Field(
                path=f"{name}.{key}",
                unit=str(extra.get("unit", "")),
                wanted=wanted + (" or null" if nullable else ""),
                meaning=info.description or "",
                choices=names,
                used_by=used_by(key) if name == "servo" else ("simulated", "emulated", "hardware"),
            )


def _split(annotation: Any) -> tuple[Any, bool]:  # noqa: ANN401 - types are what they are
    """Return a field's type without ``None`` and ``Annotated``, and whether it takes null."""
    nullable = get_origin(annotation) in (types.UnionType, Union)
    if nullable:
        annotation = next(arg for arg in get_args(annotation) if arg is not types.NoneType)
    return annotation, nullable


def _wanted(annotation: Any, info: FieldInfo) -> str:  # noqa: ANN401
    if isinstance(annotation, type) and issubclass(annotation, Estimate):
        value = annotation.model_fields["value"]
        return f"{_bounds(value.annotation, value.metadata)}, or {{value, low, high}}"
    return _bounds(annotation, info.metadata)


def _bounds(annotation: Any, metadata: list[Any]) -> str:  # noqa: ANN401
    """Describe a type and its bounds: "a number from 0 to 1", "a number above 0, at most 10"."""
    while hasattr(annotation, "__metadata__"):
        metadata = [*annotation.__metadata__, *metadata]
        annotation = annotation.__origin__
    if get_origin(annotation) is Literal:
        return "one of " + ", ".join(map(str, get_args(annotation)))
    facts: dict[str, Any] = {}
    for item in metadata:
        for one in getattr(item, "metadata", [item]):
            facts |= {
                name: getattr(one, name)
                for name in ("ge", "gt", "le", "lt", "multiple_of")
                if hasattr(one, name)
            }
    words = _KIND_NAMES.get(get_origin(annotation) or annotation, "a value")
    if "multiple_of" in facts:
        words = f"a multiple of {facts['multiple_of']:g}"
    if "ge" in facts and "le" in facts:
        return f"{words} from {_short(facts['ge'])} to {_short(facts['le'])}"
    low = f"above {_short(facts['gt'])}" if "gt" in facts else ""
    high = f"at most {_short(facts['le'])}" if "le" in facts else ""
    high = f"below {_short(facts['lt'])}" if "lt" in facts else high
    return " ".join(filter(None, [words, " and ".join(filter(None, [low, high]))]))


def _short(number: float) -> str:
    """Format a bound as a person writes it."""
    return f"{number:.0f}" if float(number).is_integer() and abs(number) < 1e8 else f"{number:g}"
