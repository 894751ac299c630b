"""``haptic-wall zwidth``: computes the stiffness and damping a servo can render."""

from __future__ import annotations

from functools import partial

import click

from haptic_wall.controller.cli.experiment import (
    Asked,
    conclude,
    experiment,
    folder_option,
    results_in,
)
from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.working import working

_MOST_SAMPLES = 30
_SECONDS = 3.0
"""Usual duration [s]"""


@click.command()
@click.option(
    "--velocity-samples",
    "samples",
    type=Number(1, _MOST_SAMPLES, whole=True, form="list"),
    metavar="N[,N...]",
    help="Lengths of the velocity difference to compare, in samples; default: CONFIG's, 1, 2, 4.",
)
@experiment(
    folder_option("Folder for zwidth.json and zwidth.png; default: a new one in ./runs/."),
    moves=False,
    of_walls=True,
    filters=True,
)
def command(asked: Asked, samples: list[int] | None) -> None:
    """Show the Z-width of CONFIG's servo: the largest stiffness over the virtual damping.

    It compares velocities over several samples and with a filter, by exact theory and by the guard.
    Nothing moves; sweep measures such points.
    """
    from haptic_wall.controller.experiments.zwidth import text, velocities, width_of
    from haptic_wall.controller.report.zwidth import plot_zwidth

    config = asked.config
    folder = results_in(asked, "zwidth")
    with working("computing", _SECONDS):
        found = [width_of(config, velocity) for velocity in velocities(config, samples)]
    report = {
        "servo": config.servo.kind,
        "clock": config.loop.clock,
        "period_s": config.period_s,
        "side": config.wall.side,
        "margin": config.guard.margin,
        "widths": [width.report() for width in found],
    }
    conclude(asked, "zwidth", folder, report, text(found), partial(plot_zwidth, found, config.wall))
