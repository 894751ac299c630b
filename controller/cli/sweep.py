"""``haptic-wall sweep``: measures the critical stiffness of a servo."""

from __future__ import annotations

import sys
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING

import click

from haptic_wall.controller.cli.experiment import (
    Asked,
    conclude,
    experiment,
    folder_option,
    moving,
    results_in,
)
from haptic_wall.controller.cli.failure import EndedEarlyError
from haptic_wall.controller.cli.interrupt import INTERRUPTED
from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.options import say
from haptic_wall.controller.cli.places import is_forced
from haptic_wall.controller.cli.working import length

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.sweep.plan import Options, PlanePoint
    from haptic_wall.controller.experiments.sweep.result import PointResult
    from haptic_wall.controller.settings.config import Config

_MOST_STEPS = 1000


@click.command()
@click.option(
    "--virtual-damping",
    "dampings",
    type=Number(form="list"),
    metavar="B[,B...]",
    required=True,
    help="Virtual damping, also negative [N·m·s/rad].",
)
@click.option(
    "--delay-steps",
    "steps",
    type=Number(0, _MOST_STEPS, whole=True, form="list"),
    metavar="n[,n...]",
    required=True,
    help="Inserted delay in whole periods, beside the delay of loop and servo.",
)
@click.option(
    "--kick",
    type=Number(0, 3, above=True, unit="rad"),
    metavar="RAD",
    help="Distance from the wall at which the shaft is released [rad]; default: for each point"
    " the largest up to 0.1 that the torque limit allows.",
)
@click.option(
    "--tolerance",
    type=Number(1e-5, 0.5),
    default=0.005,
    show_default=True,
    metavar="FRACTION",
    help="Trials continue until the standard error is this fraction of the stiffness.",
)
@experiment(
    folder_option(
        "Folder for sweep.csv, sweep.json, sweep.png and logs/; default: a new one in ./runs/. The"
        " command continues an interrupted sweep of the same settings in DIR."
    ),
    of_walls=True,
)
def command(
    asked: Asked,
    dampings: list[float],
    steps: list[int],
    kick: float | None,
    tolerance: float,
) -> None:
    """Measure the stiffness above which CONFIG's servo oscillates, at each damping and delay.

    The shaft is kicked at many stiffnesses near the limit: a soft spring moves it and holds it
    still, then the wall takes over, and its first cycles are observed. A real shaft moves by
    itself!
    """
    from haptic_wall.controller.experiments.holding import without_hand
    from haptic_wall.controller.experiments.sweep.device import Device
    from haptic_wall.controller.experiments.sweep.plan import Options, PlanePoint
    from haptic_wall.controller.experiments.sweep.result import point_text, sweep_text
    from haptic_wall.controller.experiments.sweep.sweep import ROWS, Sweep, expected_s, sweep
    from haptic_wall.controller.experiments.testbed import ExperimentTrippedError
    from haptic_wall.controller.report.sweep import plot_sweep

    effective = without_hand(asked.config)
    options = Options(kick, tolerance)
    # Each once: results are kept by point.
    settings = tuple(dict.fromkeys(PlanePoint(b, n) for n in steps for b in dampings))
    folder = results_in(asked, "sweep", ("json", "csv", "png"), others=(ROWS,))
    question = Sweep(effective, settings, options, folder)
    kept = question.kept(is_forced())
    left = tuple(setting for setting in settings if setting not in kept.done)
    _announce(effective, left, options, len(kept.done))
    if left:
        asked.may_move()

    def progress(result: PointResult) -> None:
        say(f"{len(kept.done)}/{len(settings)}  {point_text(result)}")

    said, status = "interrupted", INTERRUPTED
    with moving(effective, expected_s(effective, left, options)):
        try:
            finished = sweep(question, kept, tell=say, progress=progress)
        except ExperimentTrippedError as error:
            finished, said, status = False, str(error), error.exit_status
    if not (finished or kept.done):
        raise EndedEarlyError(f"{said}: nothing was measured, and nothing is written", status)
    found = question.points(kept)
    conclude(
        asked,
        "sweep",
        folder,
        question.report(kept) | {"out": folder},
        sweep_text(found),
        partial(plot_sweep, found, Device.of(effective)),
        map(asdict, found),
    )
    if not finished:
        many = f"{len(kept.done)} of {len(settings)} points are kept"
        say(f"{said}: {many}; the same command with --out {folder} continues")
        sys.exit(status)


def _announce(config: Config, left: tuple[PlanePoint, ...], options: Options, done: int) -> None:
    """Announce the motions."""
    from haptic_wall.controller.experiments.sweep.sweep import excursion, expected_s

    if done:
        say(f"{done} of {done + len(left)} points were measured before and are kept")
    if not left:
        say("all points are measured; --force measures them again")
        return
    if config.loop.clock == "monotonic":
        hint = ""
        if config.servo.kind == "simulated":
            hint = "; --set loop.clock=simulated does the same in seconds"
        points = "1 point" if len(left) == 1 else f"{len(left)} points"
        say(f"{points}, about {length(expected_s(config, left, options))} in real time{hint}")
    servo = config.servo
    if servo.kind == "hardware":
        far = excursion(config, left, options)
        say(
            f"the shaft of servo {servo.id} at {servo.port} will swing to both sides of its"
            f" position, by at most about {far:.2g} rad ({far * 57.3:.0f} degrees), with up to"
            f" {servo.torque_limit:g} N·m, at rising stiffness; Ctrl-C ends the motion"
        )
