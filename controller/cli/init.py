"""``haptic-wall init``: writes a commented configuration file for the user to edit."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from haptic_wall.controller.cli.options import put, writing
from haptic_wall.controller.cli.places import FileToWrite, force_option
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.settings.fields import Field, fields, sections
from haptic_wall.controller.settings.load import (
    DEFAULT_PRESET,
    load_config,
    preset_names,
    preset_text,
)
from haptic_wall.controller.system.files import whole

_HINT = """\
#
# Lines such as `# key: value` show further settings and their defaults: remove the first # to set
# one. `haptic-wall config FILE` checks the file and shows the effective values.
"""


@click.command()
@click.argument("file", type=FileToWrite())
@click.option(
    "--from",
    "preset",
    default=DEFAULT_PRESET,
    show_default=True,
    type=click.Choice(preset_names()),
    help="The preset to start from; `haptic-wall presets` lists them.",
)
@force_option
def command(file: Path, preset: str) -> None:
    """Write a commented configuration to FILE, which every command takes as CONFIG.

    The file contains the preset's settings with their comments. It lists all other settings as
    comments: default, unit, range and meaning. An existing file is kept unless --force is given.
    """
    if str(file) in preset_names():
        raise UserError(
            "found the name of a preset: as CONFIG it means the preset",
            field="FILE",
            given=file,
            wanted="another name",
            advice=f"give for example `haptic-wall init my-{file}.yaml --from {file}`",
        )
    text = commented(preset)
    with writing("FILE", file), whole(file) as part:
        part.write_text(text, encoding="utf-8")
    put(f"{file}: the preset {preset}; `haptic-wall run {file}` runs it")


def commented(preset: str) -> str:
    """Return a preset's text with all other fields as comments."""
    loaded = load_config(preset)
    kind = loaded.config.servo.kind
    others: dict[str, list[str]] = {name: [] for name in sections()}
    for field in fields().values():
        if field.path not in loaded.origins and kind in field.used_by:
            section, key = field.path.split(".")
            default = sections()[section].model_fields[key].get_default(call_default_factory=True)
            others[section] += _shown(field, key, default)
    lines = list(_with_others(preset_text(preset).splitlines(), others))
    for section, unset in others.items():
        if unset:
            lines += ["", f"# {section}:", *unset]
    return "\n".join(lines) + "\n"


def _with_others(lines: list[str], others: dict[str, list[str]]) -> Iterator[str]:
    """Yield a preset's lines; after each section its other fields, removed from ``others``."""
    hinted, inside = False, ""
    for line in [*lines, ""]:
        if not hinted and not line.startswith("#"):
            yield from _HINT.splitlines()
            hinted = True
        if inside and not line.startswith(" "):
            yield from others.pop(inside, [])
            inside = ""
        opened = re.match(r"(\w+):", line)
        if opened:
            inside = opened[1]
        yield line


def _shown(field: Field, key: str, default: Any) -> list[str]:  # noqa: ANN401 - values are what they are
    """Return the comment lines of a field that is not set."""
    value = default if isinstance(default, str) else json.dumps(default)
    unit = f"[{field.unit}] " if field.unit else ""
    return [f"  # {key}: {value}  # {unit}{field.meaning} ({field.wanted})"]
