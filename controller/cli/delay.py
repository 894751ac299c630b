"""``haptic-wall delay``: measures the loop's delay, from a sample to its torque's motion."""

from __future__ import annotations

import click

from haptic_wall.controller.cli.experiment import Asked, carry_out, experiment, folder_option
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

    config = asked.config
    carry_out(
        asked,
        "delay",
        SECONDS,
        measure=lambda folder: measure_delay(config, folder, tell=say),
        report=delay_report,
        draw=None,
        text=delay_text,
    )
