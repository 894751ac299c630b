"""``haptic-wall presets``: lists the configurations that come with the program."""

from __future__ import annotations

import click

from haptic_wall.controller.cli.options import answer, as_json, json_option
from haptic_wall.controller.settings.load import preset_names, preset_summary


@click.command()
@json_option
def command(as_json_wanted: bool) -> None:
    """List the presets, whose names can stand for CONFIG, and their purposes."""
    presets = {name: preset_summary(name) for name in preset_names()}
    if as_json_wanted:
        listed = [{"name": name, "summary": summary} for name, summary in presets.items()]
        answer(as_json({"presets": listed}))
        return
    width = max(map(len, presets))
    answer("\n".join(f"{name:<{width}}  {summary}" for name, summary in presets.items()))
