"""``haptic-wall config``: lists every setting with its value, unit, range and meaning."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import click

from haptic_wall.controller.cli.options import (
    answer,
    config_argument,
    json_option,
    set_option,
)
from haptic_wall.controller.settings.axes import OWN, RENAMED
from haptic_wall.controller.settings.axis_names import split_path
from haptic_wall.controller.settings.fields import fields
from haptic_wall.controller.settings.load import Loaded, load_config
from haptic_wall.controller.system.wrapping import wrapped


@click.command()
@config_argument(default="simulated")
@set_option
@json_option
def command(config: str, sets: tuple[str, ...]) -> None:
    """Show the effective values of CONFIG, each with its unit, range and meaning.

    Any line's name can be changed with --set NAME=VALUE, here and in every command that takes
    CONFIG. This kind of servo does not use the values marked -.
    """
    loaded = load_config(config, sets)
    listed = {path: _entry(loaded, path) for path in _paths(loaded)}
    report = {"name": loaded.name, "servo": loaded.config.servo.kind, "fields": listed}
    answer(report, lambda: _listed(report))


def _listed(report: dict[str, Any]) -> str:
    lines = [f"{report['name']} ({report['servo']} servo)"]
    section = ""
    for path, entry in report["fields"].items():
        name = path.rpartition(".")[0]
        if name != section:
            lines.append("")
            section = name
        lines += _row(path, entry)
    return "\n".join(lines)


def _paths(loaded: Loaded) -> Iterator[str]:
    """Yield the paths of all settings; of an axis those that it gives, or that differ."""
    yield from fields()
    for name in loaded.config.axes:
        for path in fields():
            own = f"axes.{name}.{path}"
            if path.split(".")[0] in OWN and (
                own in loaded.given or _value(loaded, own) != _value(loaded, path)
            ):
                yield own


def _value(loaded: Loaded, path: str) -> Any:  # noqa: ANN401 - values are what they are
    axis, bare = split_path(path)
    section, key = bare.split(".")
    if path in loaded.given and section == "bus" and key in RENAMED:
        section = "servo"  # where it has gone
    holder = loaded.config.axes[axis[5:-1]] if axis else loaded.config
    value = getattr(getattr(holder, section), key)
    if hasattr(value, "model_dump"):
        bounds = value.model_dump()
        return bounds["value"] if len(set(bounds.values())) == 1 else bounds
    return value


def _entry(loaded: Loaded, path: str) -> dict[str, Any]:
    field = fields()[split_path(path)[1]]
    return {
        "value": _value(loaded, path),
        "unit": field.unit or None,
        "wanted": field.wanted,
        "meaning": field.meaning,
        "used": loaded.config.servo.kind in field.used_by,
    }


def _row(path: str, entry: dict[str, Any]) -> Iterator[str]:
    """Format a field: name, value and unit; then, not of an axis, range and meaning."""
    mark = " " if entry["used"] else "-"
    yield f"{mark} {path:<24}  {_text(entry['value'])} {entry['unit'] or ''}".rstrip()
    if path in fields():
        yield from wrapped(f"{entry['meaning']} ({entry['wanted']})", " " * 6, " " * 6)


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
