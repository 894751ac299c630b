"""``haptic-wall init``: writes a commented configuration file for the user to edit."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import yaml

from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.options import put, writing
from haptic_wall.controller.cli.places import FileToWrite, force_option
from haptic_wall.controller.errors import ConfigError, UserError
from haptic_wall.controller.settings.fields import fields
from haptic_wall.controller.settings.load import (
    DEFAULT_PRESET,
    Loaded,
    load_config,
    preset_names,
    preset_text,
)
from haptic_wall.controller.system.files import whole

Axes = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""Settings by axis, section and name"""
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
@click.option(
    "--axes",
    "ids",
    type=Number(0, 252, whole=True, form="list"),
    metavar="ID[,ID...]",
    help="Ids of the servos, for a file with an axis for each.",
)
@force_option
def command(file: Path, preset: str, ids: list[int] | None) -> None:
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
    text = commented(preset, _axes(ids or ()))
    with writing("FILE", file), whole(file) as part:
        part.write_text(text, encoding="utf-8")
    put(f"{file}: the preset {preset}; `haptic-wall run {file}` runs it")


def _axes(ids: Sequence[int]) -> Axes:
    """Return an axis for each servo."""
    if twice := [id_ for id_ in ids if ids.count(id_) > 1]:
        raise UserError(f"found {twice[0]} twice", field="--axes", wanted="an id for each servo")
    return {f"axis_{id_}": {"servo": {"id": id_}} for id_ in ids}


ARM = "loop.rate_hz=500", "wall.law=none", "wall.position=0"
"""Defaults of a file for several axes: a rate that six servos hold, and no wall"""


def commented(preset: str, axes: Axes | None = None) -> str:
    """Return a configuration with every field, those that the preset does not set as comments.

    Args:
        preset: The preset.
        axes: In place of its own axes; empty or None: these.

    Raises:
        UserError: They do not fit the preset.
    """
    sets = ARM if axes and len(axes) > 1 else ()
    loaded = load_config(preset, sets)
    if axes:
        try:
            load_config(preset, [*sets, f"axes={json.dumps(axes)}"])
        except ConfigError as error:
            raise UserError(
                f"{preset} cannot have such axes: {error.problems[0]}",
                field="--axes",
                advice="start --from another preset, or leave --axes out and edit its own axes",
            ) from None
    config, kind = loaded.config.model_dump(mode="json"), loaded.config.servo.kind
    about = itertools.takewhile(lambda line: line.startswith("#"), preset_text(preset).splitlines())
    lines, inside = [*about, *_HINT.splitlines()], ""
    for field in fields().values():
        section, _, key = field.path.partition(".")
        if kind not in field.used_by:
            continue
        if section != inside:
            is_empty = not any(path.startswith(f"{section}.") for path in loaded.given)
            lines += ["", f"{'# ' * is_empty}{section}:"]
            inside = section
        value = config[section].get(key, {})
        given = value if isinstance(value, str) else json.dumps(value)
        unit = f"[{field.unit}] " if field.unit else ""
        mark = "" if field.path in loaded.given else "# "
        lines.append(f"  {mark}{key}: {given}  # {unit}{field.meaning} ({field.wanted})")
    axes = axes or _given_axes(loaded)
    return "\n".join([*lines, *axes_lines(axes)]) + "\n"


def _given_axes(loaded: Loaded) -> Axes:
    """Return what the axes of a configuration give of their own."""
    axes: dict[str, dict[str, dict[str, Any]]] = {name: {} for name in loaded.config.axes}
    for path in loaded.given:
        if path.startswith("axes."):
            _, name, section, key = path.split(".")
            held = loaded.config.axes[name].model_dump(mode="json")
            axes[name].setdefault(section, {})[key] = held[section][key]
    return axes


def axes_lines(axes: Axes) -> list[str]:
    """Return the section ``axes`` of a file, with a blank line before it; nothing if it has none.

    Args:
        axes: Settings by axis, section and name.
    """
    lines = ["", "axes:  # each axis gives what it has of its own of servo, model and wall"]
    for name, axis in axes.items():
        lines.append(f"  {name}:")
        for section, own in axis.items():
            flow = yaml.safe_dump(own, default_flow_style=True, sort_keys=False, width=math.inf)
            lines.append(f"    {section}: {flow.strip()}")
    return lines if axes else []
