"""``haptic-wall init``: writes a commented configuration file for the user to edit."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import click

from haptic_wall.controller.cli.options import put, writing
from haptic_wall.controller.cli.places import FileToWrite, force_option
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.settings.fields import fields
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
    """Return a configuration with every field, those that the preset does not set as comments."""
    loaded = load_config(preset)
    config, kind = loaded.config.model_dump(mode="json"), loaded.config.servo.kind
    about = itertools.takewhile(lambda line: line.startswith("#"), preset_text(preset).splitlines())
    lines, inside = [*about, *_HINT.splitlines()], ""
    for field in fields().values():
        section, _, key = field.path.partition(".")
        if kind not in field.used_by:
            continue
        if section != inside:
            is_empty = not any(path.startswith(f"{section}.") for path in loaded.origins)
            lines += ["", f"{'# ' * is_empty}{section}:"]
            inside = section
        value = config[section].get(key, {})
        given = value if isinstance(value, str) else json.dumps(value)
        unit = f"[{field.unit}] " if field.unit else ""
        mark = "" if field.path in loaded.origins else "# "
        lines.append(f"  {mark}{key}: {given}  # {unit}{field.meaning} ({field.wanted})")
    return "\n".join(lines) + "\n"
