"""``haptic-wall init``: writes a commented configuration file for the user to edit."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import yaml
from click.core import ParameterSource

from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.options import put, reading, writing
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
from haptic_wall.controller.settings.urdf import joint_ranges
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
@click.option(
    "--urdf",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="A robot's description: its joints are the axes, in order, with stops at the limits of "
    "revolute ones; ids: --axes, else 1, 2, ...",
)
@click.option(
    "--margin",
    type=Number(0, math.pi, unit="rad"),
    default=0.1,
    show_default=True,
    metavar="RAD",
    help="With --urdf: distance of the stops from the limits.",
)
@force_option
def command(
    file: Path, preset: str, ids: list[int] | None, urdf: Path | None, margin: float
) -> None:
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
    source = click.get_current_context().get_parameter_source("margin")
    if urdf is None and source is not ParameterSource.DEFAULT:
        raise UserError("of no use", field="--margin", wanted="it with --urdf")
    text = commented(preset, _axes(ids, urdf, margin))
    with writing("FILE", file), whole(file) as part:
        part.write_text(text, encoding="utf-8")
    put(f"{file}: the preset {preset}; `haptic-wall run {file}` runs it")


def _axes(ids: list[int] | None, urdf: Path | None, margin: float) -> Axes:
    """Return the axes that the options ask for."""
    if twice := [id_ for id_ in ids or () if (ids or ()).count(id_) > 1]:
        raise UserError(f"found {twice[0]} twice", field="--axes", wanted="an id for each servo")
    if urdf is None:
        return {f"axis_{id_}": {"servo": {"id": id_}} for id_ in ids or ()}
    with reading("--urdf", urdf, "a URDF"):
        ranges = joint_ranges(urdf, margin)
    ids = list(range(1, len(ranges) + 1)) if ids is None else ids
    if len(ids) != len(ranges):
        wanted = f"{len(ranges)}, one for each of {', '.join(ranges)}"
        raise UserError(f"found {len(ids)} ids", field="--axes", wanted=wanted)
    walls = (
        # from the joint's own zero, wherever the preset's wall is
        {"law": "stops", "position": 0.0, "low": ends[0], "high": ends[1]}
        if ends
        else {"law": "none"}
        for ends in ranges.values()
    )
    return {
        name: {"servo": {"id": id_}, "wall": wall}
        for name, id_, wall in zip(ranges, ids, walls, strict=True)
    }


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
                advice="give --urdf for stops at a robot's limits, start --from another preset, or "
                "leave --axes out, and edit the preset's own",
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
