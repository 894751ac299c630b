"""``haptic-wall map``: simulates the critical stiffness over virtual damping, delay and kick."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptic_wall.controller.cli.experiment import (
    Asked,
    conclude,
    experiment,
    folder_option,
    results_in,
)
from haptic_wall.controller.cli.failure import EndedEarlyError
from haptic_wall.controller.cli.interrupt import INTERRUPTED
from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.options import config_argument, say
from haptic_wall.controller.cli.places import is_forced
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.system.signals import interrupting

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.maps.maps import (
        CriticalMap,
        MapQuestion,
        Progress,
    )

_POINT_S = 0.05
"""Approximate duration of a point on one core [s]"""
_STEPS = (0, 1, 2, 3, 4, 5)
_KICKS = (0.003, 0.01, 0.03, 0.1, 0.3)
_KICK = 0.01
"""Of a servo without friction, encoder and backlash, to which the kick does not matter [rad]."""
_ROWS = "map.rows"


@click.command()
@click.option(
    "--virtual-damping",
    "dampings",
    type=Number(form="list"),
    metavar="B[,B...]",
    help="Virtual damping [N·m·s/rad]; default: 12 values from 0 to the ceiling at the longest"
    " delay.",
)
@click.option(
    "--delay-steps",
    "steps",
    type=Number(0, 1000, whole=True, form="list"),
    metavar="n[,n...]",
    help="Inserted delay in whole periods, beside servo.delay; default: 0 to 5.",
)
@click.option(
    "--kick",
    "kicks",
    type=Number(0, 3, above=True, unit="rad", form="list"),
    metavar="RAD[,RAD...]",
    help="Amplitude of the motion at the start [rad]; default: 0.003 to 0.3.",
)
@click.option(
    "--workers",
    type=Number(1, whole=True),
    metavar="N",
    help="Parallel processes; default: one per core.",
)
@click.option(
    "--dask",
    metavar="ADDRESS",
    help="Compute on the cluster of this Dask scheduler, such as tcp://127.0.0.1:8786.",
)
@click.option("--resume", is_flag=True, hidden=True, expose_value=False)  # it always does
@experiment(
    folder_option(
        "Folder for map.csv, map.json and map.png; default: a new one in ./runs/. The command"
        " continues an unfinished map of the same settings in DIR."
    ),
    config_argument("simulated"),
    moves=False,
    of_walls=True,
)
def command(
    asked: Asked,
    dampings: list[float] | None,
    steps: list[int] | None,
    kicks: list[float] | None,
    workers: int | None,
    dask: str | None,
) -> None:
    """Simulate the walls of CONFIG's servo, and find the stiffness above which motion grows.

    The servo has the parameters of servo.* (friction, loads, encoder, backlash, torque limit, lag);
    guard, safety and model.* are not used. In a two-sided wall the shaft is kicked; the shaft hits
    a one-sided wall, which returns it.
    """
    from haptic_wall.controller.experiments.maps.maps import MapQuestion
    from haptic_wall.controller.experiments.maps.servo import MapSettings
    from haptic_wall.controller.experiments.maps.table import (
        default_dampings,
        points,
        report,
        text,
    )
    from haptic_wall.controller.report.maps import plot_map

    setting = MapSettings.of(asked.config)
    chosen_steps = _STEPS if steps is None else steps
    chosen_kicks = kicks if kicks is not None else _KICKS if setting.kick_matters else (_KICK,)
    chosen_dampings = default_dampings(setting, chosen_steps) if dampings is None else dampings
    wanted = MapQuestion(setting, chosen_dampings, chosen_steps, chosen_kicks)
    say(f"{asked.name}: {wanted.points} points")
    share = 0.0

    def progress(done: int, total: int) -> None:
        nonlocal share
        share = done / total

    folder = results_in(asked, "map", ("json", "csv", "png"), others=(_ROWS,))
    with working("computing", _POINT_S * wanted.points, lambda: share), interrupting():
        found = _computed(wanted, folder, workers, dask, progress)
    conclude(
        asked, "map", folder, report(found), text(found), partial(plot_map, found), points(found)
    )
    if not found.complete:
        say(
            "interrupted: the computed points are kept, the others are empty; the same command with"
            f" --out {folder} continues"
        )
        sys.exit(INTERRUPTED)
    (folder / _ROWS).unlink(missing_ok=True)


def _computed(
    wanted: MapQuestion,
    folder: Path,
    workers: int | None,
    dask: str | None,
    progress: Progress,
) -> CriticalMap:
    """Compute the map; finished tasks are kept in the folder.

    Raises:
        EndedEarlyError: Ctrl-C has interrupted it before anything was computed.
    """
    from haptic_wall.controller.experiments.cluster import cluster
    from haptic_wall.controller.experiments.maps.maps import critical_map

    kept = wanted.kept(folder / _ROWS, fresh=is_forced())
    with nullcontext(None) if dask is None else cluster(dask) as pool:
        found = critical_map(wanted, executor=pool, workers=workers, progress=progress, kept=kept)
    if not found.count:
        text = "interrupted before anything was computed: nothing is written"
        raise EndedEarlyError(text, INTERRUPTED)
    return found
