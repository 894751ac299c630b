"""``haptic-wall sweep``: measures the critical stiffness of a servo."""

from __future__ import annotations

import sys
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptic_wall.controller.cli.ceiling import measure_ceiling
from haptic_wall.controller.cli.drawing import drawn_or_noted
from haptic_wall.controller.cli.experiment import (
    Asked,
    dask_option,
    experiment,
    folder_option,
    moving,
)
from haptic_wall.controller.cli.interrupt import INTERRUPTED
from haptic_wall.controller.cli.numbers import numbers, periods, whole_periods
from haptic_wall.controller.cli.options import say
from haptic_wall.controller.cli.places import new_stem, take_folder
from haptic_wall.controller.errors import UserError

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.sweep.plan import Options, PlanePoint
    from haptic_wall.controller.experiments.sweep.result import PointResult
    from haptic_wall.controller.settings.config import Config

_MOST_STEPS = 1000


@click.command()
@click.option(
    "--over",
    type=click.Choice(["stiffness", "damping"]),
    default="stiffness",
    show_default=True,
    help="stiffness: measure the critical stiffness at each virtual damping; damping: measure the"
    " ceiling of the virtual damping, above which the servo vibrates without any stiffness.",
)
@click.option(
    "--virtual-damping",
    "dampings",
    callback=numbers,
    metavar="B[,B...]",
    help="Virtual damping, also negative [N·m·s/rad]; needed with --over stiffness.",
)
@click.option(
    "--delay-steps",
    "steps",
    callback=periods,
    metavar="n[,n...]",
    required=True,
    help="Inserted delay in whole periods, beside the delay of loop and servo.",
)
@click.option(
    "--kick",
    type=float,
    metavar="RAD",
    help="Distance from the wall at which the shaft is released [rad]; default: for each point"
    " the largest up to 0.1 that the torque limit allows.",
)
@click.option("--fresh", is_flag=True, help="Replace an earlier sweep in DIR.")
@click.option(
    "--repeats",
    type=click.IntRange(min=1, max=100),
    default=2,
    show_default=True,
    metavar="N",
    help="Trials at each stiffness near the limit.",
)
@click.option(
    "--tolerance",
    type=click.FloatRange(min=1e-5, max=0.5),
    default=0.005,
    show_default=True,
    metavar="FRACTION",
    help="Trials continue until the standard error is this fraction of the stiffness.",
)
@click.option("--workers", type=click.IntRange(min=1), metavar="N",
              help="Parallel processes on the simulated clock; default: one per core.")  # fmt: skip
@dask_option
@experiment(
    folder_option(
        "Folder for sweep.csv, sweep.json, sweep.png and logs/; default: a new one in ./runs/. The"
        " command continues an interrupted sweep of the same settings in DIR."
    ),
    of_walls=True,
    filters=True,
)
def command(
    asked: Asked,
    over: str,
    dampings: list[float] | None,
    steps: list[float],
    kick: float | None,
    fresh: bool,
    repeats: int,
    tolerance: float,
    workers: int | None,
    dask: str | None,
) -> None:
    """Measure the stiffness above which CONFIG's servo oscillates, at each damping and delay.

    The shaft is kicked at many stiffnesses near the limit: a soft spring moves it and holds it
    still, then the wall takes over, and its first cycles are observed. A real shaft moves by
    itself!

    With --over damping the shaft travels to and fro at constant speed under rising damping, until a
    vibration grows; DIR gets ceiling.json, ceiling.png and the logs.
    """
    if over == "damping":
        measure_ceiling(asked, whole_periods(steps, _MOST_STEPS), dampings)
        return
    if not dampings:
        raise UserError(
            "found none",
            field="--virtual-damping",
            wanted="the virtual dampings at which to measure the critical stiffness",
            advice="give them, or --over damping",
        )
    from haptic_wall.controller.experiments.cluster import cluster
    from haptic_wall.controller.experiments.sweep.device import Device
    from haptic_wall.controller.experiments.sweep.plan import Options
    from haptic_wall.controller.experiments.sweep.store import PNG, SweepStore
    from haptic_wall.controller.experiments.sweep.store import SweepSettings as SweepAsked
    from haptic_wall.controller.experiments.sweep.sweep import expected_s, experiment_config, sweep
    from haptic_wall.controller.experiments.testbed import ExperimentTrippedError
    from haptic_wall.controller.processes.run_report import exit_status

    if kick is not None and not 0.0 < kick <= 3.0:
        raise UserError(f"found {kick:g}", field="--kick", wanted="a kick above 0 and up to 3 rad")
    effective = experiment_config(asked.config)
    if dask is not None and effective.loop.clock != "simulated":
        raise UserError(
            "found a run in real time",
            field="--dask",
            given=dask,
            wanted="a simulated one",
            advice="add --set loop.clock=simulated, or leave --dask out",
        )
    settings = _settings(dampings, steps)
    options = Options(kick, repeats, tolerance)
    device = Device.of(effective)
    folder = _folder(asked, fresh=fresh)
    store = SweepStore(folder, SweepAsked(effective, settings, options), fresh)
    _announce(effective, settings, options, store.done)
    if not store.complete:
        asked.may_move()
    progress = _Progress(len(settings), len(store.done))
    tripped: ExperimentTrippedError | None = None
    try:
        left = tuple(setting for setting in settings if setting not in store.done)
        with moving(effective, expected_s(effective, left, options)):
            finished = sweep(
                effective,
                store,
                settings,
                options,
                tell=say,
                progress=progress.point,
                workers=workers,
                pool=None if dask is None else cluster(dask),
            )
    except ExperimentTrippedError as error:
        finished, tripped = False, error
    points = store.points()
    if points:
        from haptic_wall.controller.report.sweep import plot_sweep

        store.write()
        draw = partial(plot_sweep, points, device, asked.name)
        drawn_or_noted("--out", folder / PNG, draw)
    report = {**store.report(asked.name), "out": folder}
    asked.answer(report, lambda: _text(points, folder))
    if not finished:
        why = "interrupted" if tripped is None else f"{tripped.stop_reason}: {tripped}"
        say(
            f"{why}: {len(points)} of {len(settings)} points are kept; the same command with"
            f" --out {folder} continues"
        )
        sys.exit(INTERRUPTED if tripped is None else exit_status(tripped.stop_reason))


def _settings(dampings: list[float], steps: list[float]) -> tuple[PlanePoint, ...]:
    from haptic_wall.controller.experiments.sweep.plan import PlanePoint

    whole = whole_periods(steps, _MOST_STEPS)
    # Each once: results are kept by point.
    return tuple(dict.fromkeys(PlanePoint(b, n) for n in whole for b in dampings))


def _folder(asked: Asked, *, fresh: bool) -> Path:
    from haptic_wall.controller.experiments.sweep.store import CSV, JSON, PNG

    if asked.out is None:
        return new_stem("--out", f"sweep-{Path(asked.name).stem}")
    continues = fresh or (asked.out / JSON).exists()  # then the store judges the folder
    take_folder("--out", asked.out, () if continues else (CSV, PNG), force=asked.force)
    return asked.out


def _announce(
    config: Config,
    settings: tuple[PlanePoint, ...],
    options: Options,
    done: dict[PlanePoint, PointResult],
) -> None:
    """Announce the motions."""
    from haptic_wall.controller.experiments.sweep.sweep import excursion, expected_s

    left = tuple(setting for setting in settings if setting not in done)
    if done:
        say(f"{len(done)} of {len(settings)} points were measured before and are kept")
    if not left:
        say("all points are measured; --fresh measures them again")
        return
    if config.loop.clock == "monotonic":
        hint = ""
        if config.servo.kind == "simulated":
            hint = "; --set loop.clock=simulated does the same in seconds"
        points = "1 point" if len(left) == 1 else f"{len(left)} points"
        say(f"{points}, {_span(expected_s(config, left, options))} in real time{hint}")
    if config.servo.kind == "hardware":
        far = excursion(config, left, options)
        say(
            f"the shaft of servo {config.servo.id} at {config.servo.port} will swing to both sides"
            f" of its position, by at most about {far:.2g} rad ({far * 57.3:.0f} degrees), with up"
            f" to {config.servo.torque_limit:g} N·m, at rising stiffness; Ctrl-C ends the motion"
        )


class _Progress:
    """Prints a line for each point, with the remaining time."""

    def __init__(self, total: int, before: int) -> None:
        self._total = total
        self._done = self._before = before
        self._began = time.monotonic()

    def point(self, _setting: PlanePoint, result: PointResult) -> None:
        self._done += 1
        left = self._total - self._done
        pace = (time.monotonic() - self._began) / (self._done - self._before)
        rest = f", {_span(pace * left)} left" if left else ""
        say(f"{self._done}/{self._total}  {_line(result)}{rest}")


def _line(point: PointResult) -> str:
    where = f"B {point.virtual_damping:g}, {point.delay_steps} steps"
    if point.measured is None:
        return f"{where}: {point.reason}"
    return (
        f"{where}: {point.measured:.4g} ± {point.uncertainty:.2g} N·m/rad"
        f" (exact {point.exact:.4g}) at {point.frequency_hz or float('nan'):.3g} Hz"
    )


def _span(seconds: float) -> str:
    return f"about {seconds:.0f} s" if seconds < 100 else f"about {seconds / 60:.0f} min"


def _text(points: list[PointResult], folder: Path) -> str:
    lines = [
        f"{'B':>9} {'delay':>8} {'measured':>10} {'±':>8} {'exact':>9} {'linear':>9}"
        f" {'friction':>9} {'f':>7} {'kick':>8}",
        f"{'N·m·s/rad':>9} {'ms':>8} {'N·m/rad':>10} {'':>8} {'':>9} {'':>9} {'':>9} {'Hz':>7}"
        f" {'rad':>8}",
    ]
    for point in points:
        lines.append(
            f"{point.virtual_damping:>9.4g} {1e3 * point.delay_s:>8.3f} {_cell(point.measured):>10}"
            f" {_cell(point.uncertainty, 2):>8} {_cell(point.exact):>9} {_cell(point.linear):>9}"
            f" {_cell(point.predicted_with_friction):>9} {_cell(point.frequency_hz, 3):>7}"
            f" {_cell(point.kick_rad, 3):>8}"
        )
        if point.reason is not None:
            lines.append(f"{'':>9} {point.reason}")
        elif point.trips:
            lines.append(f"{'':>9} trips in between: {'; '.join(point.trips)}")
    return "\n".join([*lines, "", f"written to {folder}: sweep.csv, sweep.json, sweep.png, logs/"])


def _cell(value: float | None, digits: int = 4) -> str:
    return "-" if value is None else f"{value:.{digits}g}"
