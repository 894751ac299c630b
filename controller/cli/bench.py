"""``haptic-wall bench``: measures speed on this machine, beside peers that are installed."""

from __future__ import annotations

import signal
import sys

import click

from haptic_wall.controller.bench import words
from haptic_wall.controller.cli import interrupt
from haptic_wall.controller.cli.options import answer, json_option, say
from haptic_wall.controller.system.signals import on_signals

SECTIONS = {
    "lateness": "haptic_wall.controller.bench.lateness",
    "boundary": "haptic_wall.controller.bench.boundary",
    "array_simulation": "haptic_wall.controller.bench.array_simulation",
    "torque_frames": "haptic_wall.controller.bench.torque_frames",
    "rates": "haptic_wall.controller.bench.rates",
    "lost_reply": "haptic_wall.controller.bench.lost_reply",
}
"""Module of each section, which has ``measure() -> Section``."""


@click.command()
@click.option(
    "--section",
    "names",
    multiple=True,
    type=click.Choice(list(SECTIONS)),
    help="Measure only this section (repeatable).",
)
@json_option
def command(names: tuple[str, ...]) -> None:
    """Measure timing, limits, simulation and bus cycles of this program on this machine.

    Compared programs take turns over several rounds, six minutes in all; the figures are medians.
    Times hold for this machine at this moment. Ctrl-C ends the command with a report of the
    finished sections.
    """
    from haptic_wall.controller.bench.report import measured

    chosen = {name: SECTIONS[name] for name in names or SECTIONS}

    def tell(name: str) -> None:
        say(f"measuring {name} ({list(chosen).index(name) + 1} of {len(chosen)}) ...")

    report = measured(chosen, tell)
    with on_signals(signal.SIG_IGN):  # a held Ctrl-C must not cost the report
        answer(report, lambda: words.text(report))
    if report["interrupted"]:
        sys.exit(interrupt.INTERRUPTED)
