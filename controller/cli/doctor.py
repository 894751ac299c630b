"""``haptic-wall doctor``: finds the faults of a testbed, names and applies remedies."""

from __future__ import annotations

import sys

import click

from haptic_wall.controller.cli.options import (
    answer,
    config_argument,
    json_option,
    say,
    set_option,
)
from haptic_wall.controller.doctor.checkup import examine
from haptic_wall.controller.doctor.report import Consent
from haptic_wall.controller.doctor.text import as_data, text
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.system.signals import interrupting

WRONG = 1
HARDWARE = 4


@click.command()
@config_argument(default="simulated")
@set_option
@click.option(
    "--fix", is_flag=True, help="Write the settings that remedy faults, and read them back."
)
@click.option("--yes", is_flag=True, help="With --fix: do not ask before each change.")
@click.option(
    "--change-baud",
    is_flag=True,
    help="With --fix: set a servo that answers at another baud rate to servo.baud.",
)
@json_option
def command(
    config: str,
    sets: tuple[str, ...],
    fix: bool,
    yes: bool,
    change_baud: bool,
) -> None:
    """Examine the testbed of CONFIG: port, servo, registers, timing, machine.

    It only reads, and never enables torque. --fix writes the remedies. At a terminal it asks before
    each change, unless --yes is given; without a terminal on standard input it does not ask.

    Exit status: 0 no fault; 1 something is wrong; 4 the port or the servo cannot be reached.
    """
    loaded = load_config(config, sets)
    consent = _consent(yes) if fix else None
    with interrupting():  # the port is closed
        report = examine(loaded.config, _say, consent, change_baud)
    answer(as_data(loaded.name, report), lambda: text(loaded.name, report))
    sys.exit(HARDWARE if not report.reached else WRONG if report.wrong else 0)


def _consent(yes: bool) -> Consent:
    if yes or not sys.stdin.isatty():
        return lambda _question: True
    return lambda question: click.confirm(f"  {question}?", err=True)


def _say(text: str) -> None:
    say(f"  {text} ...")
