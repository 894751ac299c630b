"""``haptic-wall set``: changes a running wall from another terminal."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.options import answer, json_option, say
from haptic_wall.controller.report.run_text import number

WAIT_S = 10.0
"""Default of the longest wait for a suitable moment [s]"""


@click.command()
@click.argument("sets", metavar="PATH=VALUE...", nargs=-1, required=True)
@click.option(
    "--run",
    "run",
    metavar="FOLDER",
    type=click.Path(path_type=Path),
    help="Folder or log of the run; default: the only one in this folder, else the only one.",
)
@click.option(
    "--wait",
    "wait_s",
    type=Number(0.0, 3600.0),
    default=WAIT_S,
    metavar="S",
    help="Longest wait for a moment at which the change is safe [s]; default: 10.",
)
@json_option
def command(sets: tuple[str, ...], run: Path | None, wait_s: float) -> None:
    """Change the wall that runs in another terminal, e.g. wall.stiffness=4.

    Several changes are made in one tick: wall.law=detents wall.count=12. You can change
    wall.stiffness, wall.damping, wall.position, delay.steps, wall.law and the numbers of the law;
    of several axes the wall of one: axes.NAME.wall.stiffness=4.
    The change waits for a moment in which it gives the shaft no energy.
    """
    from haptic_wall.controller.live.ask import ask
    from haptic_wall.controller.live.run_socket import alive, chosen

    changed = chosen(run, alive())
    if run is None and not changed.is_here:
        say(f"no wall runs in this folder; the change is for the run of {changed.log}")
    told = ask(changed, sets, wait_s, say) | {"log": str(changed.log)}
    between = "\n" if sys.stdout.isatty() else "; "
    answer(told, lambda: between.join(_lines(told)))


def _lines(told: dict[str, Any]) -> list[str]:
    changes = ", ".join(f"{path}: {value}" for path, value in told["changed"].items())
    run = f"the run of {told['log']}"
    if not changes:
        return [f"{run}: no change, the wall has these values already"]
    guard = told["guard"]
    commanded = guard["commanded"]
    return [
        f"{run}: applied after {number(told['waited_s'])} s: {changes}",
        f"commanded: {number(commanded['stiffness'])} N·m/rad and "
        f"{number(commanded['damping'])} N·m·s/rad",
        *map(str, guard["reasons"]),
    ]
