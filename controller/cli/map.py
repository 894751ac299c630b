"""``haptic-wall map``: simulates the critical stiffness over virtual damping, delay and kick."""

from __future__ import annotations

import csv
import math
import sys
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from haptic_wall.controller.cli.experiment import Asked, dask_option, experiment, folder_option
from haptic_wall.controller.cli.failure import EndedEarlyError
from haptic_wall.controller.cli.interrupt import INTERRUPTED
from haptic_wall.controller.cli.map_plan import LARGE, check_room, planned
from haptic_wall.controller.cli.numbers import numbers, periods, whole_periods
from haptic_wall.controller.cli.options import as_json, say, writing
from haptic_wall.controller.cli.places import new_stem, take_folder
from haptic_wall.controller.cli.working import DRAWING_S, working
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.file_kinds import PICTURE, RESULT, RESULT_MARK, table
from haptic_wall.controller.system.whole_file import whole

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
_COLUMNS = (
    *("virtual_damping", "delay_steps", "delay_s", "kick_rad"),
    *("simulated", "outcome", "exact", "linear", "one_sided"),
)
_NOT_MAPPED = (
    *("load_inertia", "transmission_stiffness", "transmission_damping", "encoder"),
    "chain",
    *("torque_constant", "current_bandwidth", "current_period", "dead_band", "back_emf"),
    *("current_droop", "no_load_speed", "current_filter", "current_offset", "supply", "ambient"),
    *("position", "hand", "hand_origin", "hand_direction"),
)
"""Truths of a servo that a map does not name: it refuses them, or has no use for them"""
_FILES = {"map.csv": table(",".join(_COLUMNS[:5])), "map.json": RESULT, "map.png": PICTURE}
_KINDS = {**_FILES, "map.rows": RESULT}


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
@click.option(
    "--resume", is_flag=True, help="Go on with the unfinished map that an earlier call left in DIR."
)
@experiment(
    folder_option("Where map.csv, map.json, map.png go; default: in ./runs/."),
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

    The servo has the parameters of servo.* (friction, loads, encoder, backlash, torque limit, own
    delay); guard, safety and the believed model are not used. In a two-sided wall the shaft is
    kicked; a one-sided wall is hit, and returns the shaft.
    """
    from haptic_wall.controller.experiments.maps.maps import MapQuestion, MapSettings
    from haptic_wall.controller.experiments.maps.store import MapStore

    setting = MapSettings.of(asked.config)
    chosen_steps = whole_periods(_STEPS if steps is None else steps, 1000)
    chosen_kicks = kicks if kicks is not None else _KICKS if setting.kick_matters else (_KICK,)
    if min(chosen_kicks) <= 0.0:
        raise UserError(f"found {min(chosen_kicks):g}", field="--kick", wanted="above 0 rad")
    chosen_dampings = _default_dampings(setting, chosen_steps) if dampings is None else dampings
    if asked.out is None:
        if resume:
            raise UserError("found no folder", field="--resume", wanted="the map's, as --out DIR")
        folder = new_stem("--out", "map")
        folder.mkdir()
    else:
        folder = asked.out
        take_folder("--out", folder, _KINDS, force=asked.force)
    wanted = MapQuestion(setting, chosen_dampings, chosen_steps, chosen_kicks)
    say(f"{asked.name}: {wanted.points} points")
    with MapStore(folder, wanted, resume=resume, force=asked.force) as store:
        found, interrupted = _computed(wanted, store, folder, workers, dask)
    if interrupted and not found.begun:
        text = "interrupted before anything was computed: nothing is written"
        raise EndedEarlyError(text, INTERRUPTED)
    report = _report(found, asked.name)
    files = _write(found, report, folder, force=asked.force)
    if not interrupted:
        store.remove()
    report["files"] = files
    asked.answer(report, lambda: _text(found, files))
    if interrupted:
        say(
            "interrupted: what was done until then is kept, the rest is empty; the same command"
            f" with --out {folder} --resume goes on"
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
                plan = planned(wanted, store, many, lambda part: as_json(_report(part, "")))
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

    from haptic_wall.controller.theory import max_virtual_damping

    servo = setting.servo
    delay = setting.delay(np.array(max(steps)))
    ceiling = max_virtual_damping(
        servo.inertia, servo.damping, setting.period, delay, setting.velocity_samples
    )
    # Denser at small values, where walls are used and the limits rise steeply.
    shares = np.linspace(0.0, 1.0, _DAMPINGS) ** 2
    return [float(f"{value:.4g}") for value in shares * float(ceiling)]


def _points(found: CriticalMap) -> list[dict[str, Any]]:
    points = []
    for i, steps in enumerate(found.delay_steps.tolist()):
        for j, damping in enumerate(found.virtual_damping.tolist()):
            for k, kick in enumerate(found.kick.tolist()):
                simulated = float(found.stiffness[i, j, k])
                points.append(
                    {
                        "virtual_damping": damping,
                        "delay_steps": steps,
                        "delay_s": float(found.delay[i]),
                        "kick_rad": kick,
                        "simulated": simulated if math.isfinite(simulated) else None,
                        "outcome": _outcome(simulated),
                        "exact": float(found.exact[i, j]),
                        "linear": float(found.linear[i, j]),
                        "one_sided": float(found.one_sided[i, j]),
                    }
                )
    return points


def _outcome(simulated: float) -> str:
    """Describe the result of the search."""
    if math.isnan(simulated):
        return "not computed"
    if math.isinf(simulated):
        return "never grows"
    return "grows above" if simulated > 0.0 else "always grows"


def _report(found: CriticalMap, name: str) -> dict[str, Any]:
    return {
        **RESULT_MARK,
        "name": name,
        "side": "one" if found.setting.one_sided else "both",
        "period_s": found.setting.period,
        "velocity_samples": found.setting.velocity_samples,
        "servo": {k: v for k, v in asdict(found.setting.servo).items() if k not in _NOT_MAPPED},
        "complete": found.complete,
        "points": _points(found),
    }


def _write(found: CriticalMap, report: dict[str, Any], out: Path, *, force: bool) -> list[Path]:
    from haptic_wall.controller.report.maps import plot_map

    def csv_table(path: Path) -> None:
        with path.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, _COLUMNS)
            writer.writeheader()
            writer.writerows(report["points"])

    def json_text(path: Path) -> None:
        path.write_text(as_json(report) + "\n", encoding="utf-8")

    def picture(path: Path) -> None:
        plot_map(found, report["name"], path)

    files = [out / name for name in _FILES]
    drawing = working("drawing the picture", DRAWING_S)
    with drawing, writing("--out", out), ExitStack() as all_or_none:
        for file, kind, write in zip(
            files, _FILES.values(), (csv_table, json_text, picture), strict=True
        ):
            write(all_or_none.enter_context(whole(file, kind, force=force)))
    return files


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
