"""``haptic-wall bench``: speed on this machine, beside that of peers where they are installed."""

from __future__ import annotations

import re
import signal
import sys
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from controller.benchmarks import words
from controller.cli import interrupt
from controller.cli.options import answer, as_json, json_option, say, writing
from controller.cli.places import force_option, take_file
from controller.file_kinds import Kind
from controller.signals import on_signals
from controller.whole_file import whole

SECTIONS = {
    "lateness": "controller.benchmarks.lateness",
    "stages": "controller.benchmarks.stages",
    "boundary": "controller.benchmarks.boundary",
    "array_simulation": "controller.benchmarks.array_simulation",
    "torque_frames": "controller.benchmarks.torque_frames",
    "highest_rate": "controller.benchmarks.highest_rate",
    "bus_cycle": "controller.benchmarks.bus_cycle",
    "lost_reply": "controller.benchmarks.lost_reply",
    "telemetry_row": "controller.benchmarks.telemetry_row",
    "detector": "controller.benchmarks.detector",
}
"""Each section's module, which has ``measure() -> Section``."""
ABOUT_S = {
    "lateness": 90,
    "stages": 60,
    "boundary": 15,
    "array_simulation": 12,
    "torque_frames": 35,
    "highest_rate": 150,
    "bus_cycle": 30,
    "lost_reply": 8,
    "telemetry_row": 3,
    "detector": 1,
}
"""What each takes with its peers [s]; a busy machine takes up to half as long again"""
_WIDTH = 98
_PAGE = Kind(
    "a report of haptic-wall bench",
    re.compile(rb"<!DOCTYPE html>.{0,400}<title>haptic-wall ", re.DOTALL),
)


@click.command()
@click.option(
    "--section",
    "names",
    multiple=True,
    type=click.Choice(list(SECTIONS)),
    help="Only this part (repeatable).",
)
@click.option(
    "--html",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write the report as one HTML page too, with histograms.",
)
@force_option
@json_option
def command(names: tuple[str, ...], html: Path | None, force: bool, as_json_wanted: bool) -> None:
    """Measure how well this machine keeps time, computes limits, simulates walls, talks to servos.

    Pieces of work that are compared take turns over several rounds; the figures are medians. Times
    are of this machine, now: nothing is asserted about another. A Ctrl-C ends it with a report of
    what is finished.
    """
    from controller.benchmarks.report import measured

    if html is not None:
        take_file("--html", html, _PAGE, force=force)
    chosen = {name: SECTIONS[name] for name in names or SECTIONS}
    say(f"this takes about {_length(sum(ABOUT_S[name] for name in chosen))}")

    def tell(name: str) -> None:
        place = list(chosen).index(name) + 1
        say(f"measuring {name} ({place} of {len(chosen)}) ...")

    report = measured(chosen, tell)
    with on_signals(signal.SIG_IGN):  # a held Ctrl-C must not cost the report
        answer(as_json(report) if as_json_wanted else _text(report))
        if html is not None:
            from controller.benchmarks.page import page

            with writing("--html", html), whole(html, _PAGE, force=force) as part:
                part.write_text(page(report), encoding="utf-8")
    if report["interrupted"]:
        sys.exit(interrupt.INTERRUPTED)


def _length(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} minutes"


def _text(report: Mapping[str, Any]) -> str:
    lines = [words.hardware(report)]
    lines += _folded(words.installed(report), 0)
    lines.append(words.meanwhile(report))
    if report["machine"]["realtime"]:
        for line in words.rights(report):
            lines += _folded(line, 0)
    for name, section in report["sections"].items():
        took = f"{section['seconds']:.0f} s, {words.stolen(section['steal_percent'])}"
        lines += ["", f"{words.title(name)} ({took})"]
        for shows_not, rows in words.grouped(section["rows"]):
            lines += [_line(row) for row in rows]
            lines += _folded(f"does not show {shows_not}", 4)
        for note in section["notes"]:
            lines += _folded(note, 2)
    if report["interrupted"]:
        lines += ["", "interrupted: only what is above was finished"]
    return "\n".join(lines)


def _line(row: Mapping[str, Any]) -> str:
    spread = words.quartiles(row)
    value = " ".join(part for part in (words.figure(row["value"]), words.unit(row)) if part)
    return f"  {value}{f' ({spread})' if spread else ''}  {row['name']}"


def _folded(text: str, indent: int) -> list[str]:
    space = " " * indent
    return textwrap.wrap(text, _WIDTH, initial_indent=space, subsequent_indent=space)
