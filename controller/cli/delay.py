"""``haptic-wall delay``: measures the loop's delay, from a sample to its torque's motion."""

from __future__ import annotations

import click

from haptic_wall.controller.cli.experiment import Asked, carry_out, experiment, folder_option
from haptic_wall.controller.cli.numbers import Number
from haptic_wall.controller.cli.options import say


@click.command()
@click.option(
    "--delay-steps",
    "steps",
    type=Number(0, 200, whole=True, form="list"),
    metavar="n[,n...]",
    help="Inserted delays to measure, in whole periods, beside CONFIG's; default: 0, and 5 more"
    " than CONFIG's.",
)
@experiment(folder_option("Folder for delay.json and the logs; default: a new one in ./runs/."))
def command(asked: Asked, steps: list[int] | None) -> None:
    """Measure the delay of CONFIG's loop from torque command to motion, and its parts.

    The shaft moves as for identify. Runs with an inserted delay check the method: the result
    must contain that delay.
    """
    from haptic_wall.controller.experiments.delay import (
        CHECK_STEPS,
        RUN_S,
        START_S,
        delay_report,
        delay_text,
        measure_delay,
    )

    config = asked.config
    chosen = [0, config.delay.steps + CHECK_STEPS] if steps is None else steps
    carry_out(
        asked,
        "delay",
        START_S + RUN_S * len(chosen),
        measure=lambda folder: measure_delay(config, folder, chosen, tell=say),
        report=lambda found: delay_report(found, config.period_s, config.belief().delay.high),
        draw=None,
        text=lambda found: delay_text(found, config.period_s),
    )
