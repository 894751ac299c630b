"""``haptic-wall delay``: measures the loop's delay, from a sample to its torque's motion."""

from __future__ import annotations

import click

from haptic_wall.controller.cli.experiment import (
    Asked,
    conclude,
    experiment,
    folder_option,
    moving,
    results_in,
)
from haptic_wall.controller.cli.options import say


@click.command()
@experiment(folder_option("Folder for delay.json and the logs; default: a new one in ./runs/."))
def command(asked: Asked) -> None:
    """Measure the delay of CONFIG's loop from torque command to motion, and its parts.

    The shaft moves as for identify.
    """
    from haptic_wall.controller.experiments.delay import (
        SECONDS,
        delay_report,
        delay_text,
        measure_delay,
    )

    folder = results_in(asked, "delay")
    asked.may_move()
    with moving(asked.config, SECONDS):
        found = measure_delay(asked.config, folder, tell=say)
    conclude(asked, "delay", folder, delay_report(found), delay_text(found))
