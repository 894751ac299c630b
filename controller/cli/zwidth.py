"""``haptic-wall zwidth``: computes and measures the stiffness and damping a servo can render."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptic_wall.controller.cli.experiment import (
    Asked,
    carry_out,
    experiment,
    folder_option,
    say_swing,
)
from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.options import say
from haptic_wall.controller.cli.places import is_forced

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.zwidth import Width

_MOST_SAMPLES = 30


@click.command()
@click.option(
    "--velocity-samples",
    "samples",
    type=Number(1, _MOST_SAMPLES, whole=True, form="list"),
    metavar="N[,N...]",
    help="Lengths of the velocity difference to compare, in samples; default: CONFIG's, 1, 2, 4.",
)
@click.option(
    "--measure",
    type=click.Choice(["own", "all", "none"]),
    help="own: measure the boundary with CONFIG's velocity; all: with all that are compared; none:"
    " do not measure. Default: all on the simulated clock, otherwise own.",
)
@experiment(
    folder_option(
        "Folder for zwidth.json, zwidth.png and the measured points; default: a new one in ./runs/."
        " The command continues an interrupted call of the same settings in DIR."
    ),
    of_walls=True,
    filters=True,
)
def command(asked: Asked, samples: list[int] | None, measure: str | None) -> None:
    """Show the Z-width of CONFIG's servo: the largest stiffness over the virtual damping.

    It compares velocities over several samples and with a filter: by exact theory, by the guard,
    and by measurements as in sweep. A real shaft moves by itself, unless --measure none is given.
    """
    from haptic_wall.controller.experiments.zwidth import measure_points, text, velocities, width_of
    from haptic_wall.controller.report.zwidth import plot_zwidth

    config = asked.config
    which = measure or ("all" if config.loop.clock == "simulated" else "own")
    widths = tuple(width_of(config, velocity) for velocity in velocities(config, samples))
    chosen = {"own": widths[:1], "all": widths, "none": ()}[which]
    seconds = _announced(asked, chosen)
    if not chosen:
        asked = replace(asked, yes=True)  # nothing moves

    def measured(folder: Path) -> Sequence[Width]:
        measure_points(chosen, folder / "measured", is_forced(), say)
        return widths

    carry_out(
        asked,
        "zwidth",
        seconds,
        measured,
        lambda found: {
            "servo": config.servo.kind,
            "clock": config.loop.clock,
            "period_s": config.period_s,
            "side": config.wall.side,
            "margin": config.guard.margin,
            "widths": [width.report() for width in found],
        },
        lambda found, name, path: plot_zwidth(found, config.wall, name, path),
        text,
        others=("measured",),
    )


def _announced(asked: Asked, chosen: Sequence[Width]) -> float:
    """Announce the motions; return about how long they take in real time [s]."""
    from haptic_wall.controller.experiments.sweep.sweep import excursion, expected_s

    config = asked.config
    sweeps = [each for width in chosen if (each := width.sweep(Path())) is not None]
    asked_for = [(each.config, each.settings, each.options) for each in sweeps]
    seconds = sum(expected_s(*each) for each in asked_for)
    if chosen and config.loop.clock != "simulated":
        say(f"about {seconds / 60.0:.0f} min in real time")
        if config.servo.kind == "hardware":
            far = max((excursion(*each) for each in asked_for), default=0.0)
            say_swing(config.servo, far)
    return seconds
