"""``haptic-wall delay``: measures the loop's delay, from a sample to its torque's motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from haptic_wall.controller.cli.experiment import Asked, carry_out, experiment, folder_option
from haptic_wall.controller.cli.numbers import Number, Numbers
from haptic_wall.controller.cli.options import say
from haptic_wall.controller.guard.delay_parts import ms

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.delay import LoopDelay


@click.command()
@click.option(
    "--delay-steps",
    "steps",
    type=Numbers(Number(0, 200, whole=True)),
    metavar="n[,n...]",
    help="Inserted delays to measure, in whole periods, beside CONFIG's; default: 0, and 5 more"
    " than CONFIG's.",
)
@experiment(
    folder_option("Folder for delay.json, delay.png and the logs; default: a new one in ./runs/.")
)
def command(asked: Asked, steps: list[int] | None) -> None:
    """Measure the delay of CONFIG's loop from torque command to motion, and its parts.

    The shaft moves as for ``identify``. Runs with an inserted delay check the method: the result
    must contain that delay.
    """
    from haptic_wall.controller.experiments.delay import (
        CHECK_STEPS,
        RUN_S,
        START_S,
        delay_report,
        measure_delay,
    )
    from haptic_wall.controller.report.delay import plot_delay

    config = asked.config
    chosen = [0, config.delay.steps + CHECK_STEPS] if steps is None else steps
    carry_out(
        asked,
        "delay",
        START_S + RUN_S * len(chosen),
        measure=lambda folder: measure_delay(config, folder, chosen, tell=say),
        report=lambda found: delay_report(found, config.period_s, config.belief().delay.high),
        draw=plot_delay,
        text=lambda found: _text(found, config.period_s),
    )


def _text(found: LoopDelay, period: float) -> list[str]:
    """Format a table of the parts, one of the recovered delays, and the notes."""
    lines = [
        f"delay from sample to motion  {found.total.in_ms()}",
        f"  inserted                   {ms(found.configured * period)}",
        f"  age of the sample          {ms(found.age_median)} (median; the guard counts"
        f" {ms(found.age_high)})",
        f"  device, sending to motion  {found.device.in_ms()}",
        "",
        f"{'inserted':>10}  {'measured':>20}  {'recovered':>20}",
    ]
    for point in found.points:
        recovered = point.recovered.in_ms() if point.recovered else "(reference)"
        lines.append(f"{ms(point.inserted):>10}  {point.total.in_ms():>20}  {recovered:>20}")
    return [*lines, *found.notes]
