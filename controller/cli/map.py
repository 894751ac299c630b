"""``haptic-wall map``: simulates the critical stiffness over virtual damping, delay and kick."""

from __future__ import annotations

import math
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptic_wall.controller.cli.experiment import Asked, dask_option, experiment, folder_option
from haptic_wall.controller.cli.failure import EndedEarlyError
from haptic_wall.controller.cli.interrupt import INTERRUPTED
from haptic_wall.controller.cli.map_files import FILES, json_parts, report_of, write_map
from haptic_wall.controller.cli.map_plan import LARGE, check_room, planned
from haptic_wall.controller.cli.numbers import numbers, periods, whole_periods
from haptic_wall.controller.cli.options import answer, answer_in_parts, say
from haptic_wall.controller.cli.places import new_stem, take_folder
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.signals import interrupting

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.maps.maps import CriticalMap, MapQuestion, MapSettings
    from haptic_wall.controller.experiments.maps.store import MapStore

_POINT_S = 0.05
"""Approximate duration of a point on one core [s]"""
_STEPS = (0, 1, 2, 3, 4, 5)
_KICKS = (0.003, 0.01, 0.03, 0.1, 0.3)
_KICK = 0.01
"""Of a servo without friction, encoder and backlash, to which the kick does not matter [rad]."""
_DAMPINGS = 12


@click.command()
@click.option(
    "--virtual-damping",
    "dampings",
    callback=numbers,
    metavar="B[,B...]",
    help="Virtual damping [N·m·s/rad]; default: 12 values from 0 to the ceiling at the longest"
    " delay.",
)
@click.option(
    "--delay-steps",
    "steps",
    callback=periods,
    metavar="n[,n...]",
    help="Inserted delay in whole periods, beside servo.delay; default: 0 to 5.",
)
@click.option(
    "--kick",
    "kicks",
    callback=numbers,
    metavar="RAD[,RAD...]",
    help="Amplitude of the motion at the start [rad]; default: 0.003 to 0.3.",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    metavar="N",
    help="Parallel processes; default: one per core.",
)
@dask_option
@click.option("--resume", is_flag=True, help="Continue the unfinished map in DIR.")
@experiment(
    folder_option("Folder for map.csv, map.json and map.png; default: a new one in ./runs/."),
    "simulated",
    moves=False,
    of_walls=True,
)
def command(
    asked: Asked,
    dampings: list[float] | None,
    steps: list[float] | None,
    kicks: list[float] | None,
    workers: int | None,
    dask: str | None,
    resume: bool,
) -> None:
    """Simulate the walls of CONFIG's servo, and find the stiffness above which motion grows.

    The servo has the parameters of servo.* (friction, loads, encoder, backlash, torque limit, lag);
    guard, safety and model.* are not used. In a two-sided wall the shaft is kicked; the shaft hits
    a one-sided wall, which returns it.
    """
    from haptic_wall.controller.experiments.maps.maps import MapQuestion, MapSettings
    from haptic_wall.controller.experiments.maps.store import MapStore

    setting = MapSettings.of(asked.config)
    chosen_steps = whole_periods(_STEPS if steps is None else steps, 1000)
    chosen_kicks = kicks if kicks is not None else _KICKS if setting.kick_matters else (_KICK,)
    if min(chosen_kicks) <= 0.0:
        raise UserError(f"found {min(chosen_kicks):g}", field="--kick", wanted="a kick above 0 rad")
    chosen_dampings = _default_dampings(setting, chosen_steps) if dampings is None else dampings
    if asked.out is None:
        if resume:
            raise UserError("found without --out", field="--resume", advice="add --out DIR")
        folder = new_stem("--out", "map")
    else:
        folder = asked.out
        take_folder("--out", folder, () if resume else FILES, force=asked.force)
    wanted = MapQuestion(setting, chosen_dampings, chosen_steps, chosen_kicks)
    say(f"{asked.name}: {wanted.points} points")
    with interrupting(), MapStore(folder, wanted, resume=resume, force=asked.force) as store:
        found, interrupted = _computed(wanted, store, folder, workers, dask)
    if interrupted and not found.begun:
        text = "interrupted before anything was computed: nothing is written"
        raise EndedEarlyError(text, INTERRUPTED)
    report = report_of(found, asked.name)
    files = write_map(found, report, folder)
    if not interrupted:
        store.remove()
    if asked.json:
        answer_in_parts(json_parts(found, {**report, "files": files}))
    else:
        answer(_text(found, files))
    if interrupted:
        say(
            "interrupted: the points computed so far are kept, the others are empty; the same"
            f" command with --out {folder} --resume continues"
        )
        sys.exit(INTERRUPTED)


def _computed(
    wanted: MapQuestion, store: MapStore, folder: Path, workers: int | None, dask: str | None
) -> tuple[CriticalMap, bool]:
    """Compute the map; return it, and whether Ctrl-C has interrupted it."""
    from haptic_wall.controller.experiments.cluster import cluster
    from haptic_wall.controller.experiments.maps.maps import MapInterruptedError, critical_map
    from haptic_wall.controller.experiments.processes import cores

    share = 0.0

    def progress(done: int, total: int) -> None:
        nonlocal share
        share = done / total

    with ExitStack() as during:
        pool = None if dask is None else during.enter_context(cluster(dask))
        if wanted.points >= LARGE:
            many = workers or cores() if pool is None else pool.size
            with working("planning"):
                plan = planned(wanted, store, many)
            check_room(folder, plan)
        during.enter_context(working("computing", _POINT_S * wanted.points, lambda: share))
        try:
            found = critical_map(
                wanted.setting,
                wanted.dampings,
                wanted.delay_steps,
                wanted.kicks,
                executor=pool,
                workers=workers,
                progress=progress,
                done=store.done,
                finished=store.add,
            )
        except MapInterruptedError as stopped:
            return stopped.partial, True
    return found, False


def _default_dampings(setting: MapSettings, steps: list[int]) -> list[float]:
    import numpy as np

    from haptic_wall.controller.experiments.maps.limits import ceiling

    delay = float(setting.delay(np.array(max(steps))))
    most = ceiling(setting.servo, setting.period, delay, setting.velocity_samples)
    # Denser at small values, where walls are used and the limits rise steeply.
    shares = np.linspace(0.0, 1.0, _DAMPINGS) ** 2
    return [float(f"{value:.4g}") for value in shares * most]


def _text(found: CriticalMap, files: list[Path]) -> str:
    """Format a table of the largest kick, and the files."""
    import numpy as np

    k = int(np.argmax(found.kick))
    lines = [
        f"critical stiffness [N·m/rad], simulated, kick {found.kick[k]:g} rad",
        f"{'B [N·m·s/rad]':>14}  "
        + "".join(f"{f'{1e3 * delay:.4g} ms':>10}" for delay in found.delay),
    ]
    for j, damping in enumerate(found.virtual_damping):
        cells = "".join(f"{_cell(value):>10}" for value in found.stiffness[:, j, k].tolist())
        lines.append(f"{damping:>14.4g}  {cells}")
    return "\n".join([*lines, "", "written", *(f"  {path}" for path in files)])


def _cell(value: float) -> str:
    if math.isfinite(value):
        return f"{value:.4g}"
    return "-" if math.isnan(value) else "none"
