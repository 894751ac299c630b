"""``haptic-wall config``: lists every setting with its value, unit, origin, range and meaning."""

from __future__ import annotations

from typing import Any

import click

from haptic_wall.controller.cli.options import (
    answer,
    config_argument,
    json_option,
    set_option,
)
from haptic_wall.controller.settings.fields import Field, fields
from haptic_wall.controller.settings.load import Loaded, load_config
from haptic_wall.controller.system.wrapping import wrapped

_VALUE_WIDTH = 40
"""Width of a value with its unit; a belief with bounds is the longest."""


@click.command()
@config_argument(default="simulated")
@set_option
@json_option
def command(config: str, sets: tuple[str, ...]) -> None:
    """Show the effective values of CONFIG, each with its unit, origin, range and meaning.

    Any line's name can be changed with --set NAME=VALUE, here and in every command that takes
    CONFIG. This kind of servo does not use the values marked -.
    """
    loaded = load_config(config, sets)
    listed = {field.path: _entry(loaded, field) for field in fields().values()}
    report = {"name": loaded.name, "servo": _kind(loaded), "fields": listed}
    answer(report, lambda: _listed(loaded))


def _listed(loaded: Loaded) -> str:
    lines = [f"{loaded.name} ({_kind(loaded)} servo)"]
    section = ""
    for field in fields().values():
        name = field.path.split(".")[0]
        if name != section:
            lines.append("")
            section = name
        lines.append(_row(loaded, field))
    return "\n".join(lines)


def _kind(loaded: Loaded) -> str:
    return loaded.config.servo.kind


def _value(loaded: Loaded, field: Field) -> Any:  # noqa: ANN401 - values are what they are
    section, key = field.path.split(".")
    value = getattr(getattr(loaded.config, section), key)
    if hasattr(value, "model_dump"):
        bounds = value.model_dump()
        return bounds["value"] if len(set(bounds.values())) == 1 else bounds
    return value


def _entry(loaded: Loaded, field: Field) -> dict[str, Any]:
    return {
        "value": _value(loaded, field),
        "unit": field.unit or None,
        "from": loaded.origins.get(field.path, "default"),
        "wanted": field.wanted,
        "meaning": field.meaning,
        "used": _kind(loaded) in field.used_by,
    }


def _row(loaded: Loaded, field: Field) -> str:
    """Format a field in two or more lines: name, value, unit and origin; then range and meaning."""
    origin = loaded.origins.get(field.path, "default")
    value = f"{_text(_value(loaded, field))} {field.unit}"
    mark = " " if _kind(loaded) in field.used_by else "-"
    head = f"{mark} {field.path:<24}  {value:<{_VALUE_WIDTH}}  {origin}"
    return "\n".join([head, *wrapped(f"{field.meaning} ({field.wanted})", " " * 6, " " * 6)])


def _text(value: Any) -> str:  # noqa: ANN401
    if value is None:
        return "null"
    if isinstance(value, tuple):
        return " ".join(map(str, value)) or "none"
    if isinstance(value, dict) and "value" in value:
        return f"{value['value']:g} ({value['low']:g} to {value['high']:g})"
    if isinstance(value, dict):
        return ", ".join(f"{name}: {inner}" for name, inner in value.items()) or "none"
    return f"{value:.8g}" if isinstance(value, float) else str(value)
