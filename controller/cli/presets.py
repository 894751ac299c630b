"""``haptic-wall presets``: lists the configurations that come with the program."""

from __future__ import annotations

import click

from haptic_wall.controller.cli.options import answer, json_option
from haptic_wall.controller.settings.load import preset_names, preset_summary


@click.command()
@json_option
def command() -> None:
    """List the presets, whose names can stand for CONFIG, and their purposes."""
    presets = {name: preset_summary(name) for name in preset_names()}
    listed = [{"name": name, "summary": summary} for name, summary in presets.items()]
    width = max(map(len, presets))
    lines = (f"{name:<{width}}  {summary}" for name, summary in presets.items())
    answer({"presets": listed}, lambda: "\n".join(lines))
