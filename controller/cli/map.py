"""``haptic-wall map``: simulates the critical stiffness over virtual damping, delay and kick."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from haptic_wall.controller.cli.experiment import (
    Asked,
    carry_out,
    experiment,
    folder_option,
)
from haptic_wall.controller.cli.failure import EndedEarlyError
from haptic_wall.controller.cli.interrupt import INTERRUPTED
from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.options import say
from haptic_wall.controller.cli.places import is_forced
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.system.signals import interrupting

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.maps.maps import (
        CriticalMap,
        MapQuestion,
        Progress,
    )
    from haptic_wall.controller.experiments.maps.servo import MapSettings

_POINT_S = 0.05
"""Approximate duration of a point on one core [s]"""
_STEPS = (0, 1, 2, 3, 4, 5)
_KICKS = (0.003, 0.01, 0.03, 0.1, 0.3)
_KICK = 0.01
"""Of a servo without friction, encoder and backlash, to which the kick does not matter [rad]."""
_DAMPINGS = 12
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
    type=Number(0, above=True, unit="rad", form="list"),
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
    "simulated",
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
    from haptic_wall.controller.report.maps import plot_map

    setting = MapSettings.of(asked.config)
    chosen_steps = _STEPS if steps is None else steps
    chosen_kicks = kicks if kicks is not None else _KICKS if setting.kick_matters else (_KICK,)
    chosen_dampings = _default_dampings(setting, chosen_steps) if dampings is None else dampings
    wanted = MapQuestion(setting, chosen_dampings, chosen_steps, chosen_kicks)
    say(f"{asked.name}: {wanted.points} points")
    share = 0.0

    def progress(done: int, total: int) -> None:
        nonlocal share
        share = done / total

    def measure(folder: Path) -> CriticalMap:
        with interrupting():
            return _computed(wanted, folder, workers, dask, progress)

    seconds = _POINT_S * wanted.points
    carry_out(
        asked,
        "map",
        seconds,
        measure,
        _report,
        plot_map,
        _text,
        rows=_points,
        others=(_ROWS,),
        work=working("computing", seconds, lambda: share),
        ended=_ended,
    )
    if asked.out is not None:
        (asked.out / _ROWS).unlink(missing_ok=True)


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


def _report(found: CriticalMap) -> dict[str, Any]:
    setting = found.setting
    return {
        "side": "one" if setting.one_sided else "both",
        "period_s": setting.period,
        "velocity_samples": setting.velocity_samples,
        "servo": asdict(setting.servo),
        "complete": found.complete,
        "points": list(_points(found)),
    }


def _points(found: CriticalMap) -> Iterator[dict[str, Any]]:
    """Yield the points of the table and of the report."""
    for i, steps in enumerate(found.delay_steps.tolist()):
        for j, damping in enumerate(found.virtual_damping.tolist()):
            for k, kick in enumerate(found.kick.tolist()):
                value = float(found.stiffness[i, j, k])
                yield {
                    "virtual_damping": damping,
                    "delay_steps": steps,
                    "delay_s": float(found.delay[i]),
                    "kick_rad": kick,
                    "simulated": value if math.isfinite(value) else None,
                    "outcome": _outcome(value),
                    "exact": float(found.exact[i, j]),
                    "linear": float(found.linear[i, j]),
                    "one_sided": float(found.one_sided[i, j]),
                }


def _outcome(simulated: float) -> str:
    """Describe the result of the search."""
    if math.isnan(simulated):
        return "not computed"
    if math.isinf(simulated):
        return "never grows"
    return "grows above" if simulated > 0.0 else "always grows"


def _ended(found: CriticalMap) -> tuple[str, int] | None:
    if found.complete:
        return None
    text = "interrupted: the computed points are kept, the others are empty; the same command with"
    return text, INTERRUPTED


def _default_dampings(setting: MapSettings, steps: Sequence[int]) -> list[float]:
    import numpy as np

    most = setting.loop.ceiling(float(setting.delay(np.array(max(steps)))))
    # Denser at small values, where walls are used and the limits rise steeply.
    shares = np.linspace(0.0, 1.0, _DAMPINGS) ** 2
    return [float(f"{value:.4g}") for value in shares * most]


def _text(found: CriticalMap) -> list[str]:
    """Format a table of the largest kick."""
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
    return lines


def _cell(value: float) -> str:
    if math.isfinite(value):
        return f"{value:.4g}"
    return "-" if math.isnan(value) else "none"
