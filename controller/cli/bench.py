"""``haptic-wall bench``: speed on this machine, beside that of peers where they are installed."""

from __future__ import annotations

import importlib
import textwrap
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import click

from controller.benchmarks.machine import machine, versions
from controller.benchmarks.rows import Section
from controller.cli.options import answer, as_json, json_option

SECTIONS = {
    "boundary": "controller.benchmarks.boundary",
    "array_simulation": "controller.benchmarks.array_simulation",
    "bus_cycle": "controller.benchmarks.bus_cycle",
    "detector": "controller.benchmarks.detector",
}
"""Each section's module, which has ``measure() -> Section``."""
_WIDTH = 98


@click.command()
@click.option(
    "--section",
    "names",
    multiple=True,
    type=click.Choice(list(SECTIONS)),
    help="Only this part (repeatable).",
)
@json_option
def command(names: tuple[str, ...], as_json_wanted: bool) -> None:
    """Measure how fast this machine computes limits, simulates walls and talks to servos.

    Pieces of work that are compared take turns over several rounds; the figures are medians. Times
    are of this machine, now: nothing is asserted about another.
    """
    found: dict[str, Section] = {}
    for name in dict.fromkeys(names or SECTIONS):
        click.echo(f"measuring {name} ...", err=True)
        found[name] = importlib.import_module(SECTIONS[name]).measure()
    report = {
        "machine": machine(),
        "versions": versions(),
        "sections": {name: asdict(section) for name, section in found.items()},
    }
    answer(as_json(report) if as_json_wanted else _text(report))


def _text(report: Mapping[str, Any]) -> str:
    on = report["machine"]
    cores = "unknown" if on["cores"] is None else on["cores"]
    installed = ", ".join(
        f"{name} {number}" if number else f"{name} not installed"
        for name, number in report["versions"].items()
    )
    lines = [f"{on['processor']}, {cores} cores, {on['system']}", installed]
    for name, section in report["sections"].items():
        lines += ["", name.replace("_", " ")]
        for row in section["rows"]:
            unit = "" if row["unit"] == "1" else f" {row['unit']}"
            lines.append(f"  {_figure(row['value'])}{unit}  {row['name']}")
            lines += _folded(f"does not show {row['shows_not']}", 4)
        for note in section["notes"]:
            lines += _folded(note, 2)
    return "\n".join(lines)


def _figure(value: float) -> str:
    """Three digits; large numbers in groups of thousands."""
    return f"{float(f'{value:.3g}'):,.0f}" if value >= 1000 else f"{value:.3g}"


def _folded(text: str, indent: int) -> list[str]:
    space = " " * indent
    return textwrap.wrap(text, _WIDTH, initial_indent=space, subsequent_indent=space)
