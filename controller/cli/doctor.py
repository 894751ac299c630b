"""``haptic-wall doctor``: finds the faults of a testbed, names and applies remedies."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import click

from haptic_wall.controller.cli.options import (
    answer,
    config_argument,
    json_option,
    say,
    set_option,
)
from haptic_wall.controller.cli.wrapping import wrapped
from haptic_wall.controller.doctor.checkup import examine
from haptic_wall.controller.doctor.report import Consent, Report
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.system.signals import interrupting
from haptic_wall.hw.servo import Check

WRONG = 1
HARDWARE = 4
TORQUE = "No torque was enabled."


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
    answer(_json(loaded.name, report), lambda: _text(loaded.name, report))
    sys.exit(HARDWARE if not report.reached else WRONG if report.wrong else 0)


def _consent(yes: bool) -> Consent:
    if yes or not sys.stdin.isatty():
        return lambda _question: True
    return lambda question: click.confirm(f"  {question}?", err=True)


def _say(text: str) -> None:
    say(f"  {text} ...")


def _json(name: str, report: Report) -> dict[str, Any]:
    return {
        "name": name,
        "checks": [asdict(finding) for finding in report.found.values()],
        "changes": [change._asdict() for change in report.changes],
        "not_examined": report.not_examined,
        "reached": report.reached,
        "suits": report.suits,
    }


def _text(name: str, report: Report) -> str:
    column = max((len(finding.name) for finding in report.found.values()), default=0)
    lines = [f"{name}. {TORQUE}", ""]
    for finding in report.found.values():
        lines += _rows(finding, column)
    if report.changes:
        lines += ["", "Changed:"]
        lines += [f"  {change}" for change in report.changes]
    if report.not_examined:
        lines += ["", f"Not examined: {', '.join(report.not_examined)}"]
    lines += ["", _verdict(report)]
    return "\n".join(lines)


def _rows(finding: Check, column: int) -> Iterator[str]:
    mark = "WRONG" if not finding.ok else "-" if not finding.applies else "ok"
    wanted = f" (wanted: {finding.wanted})" if not finding.ok else ""
    head = f"{mark:<5}  {finding.name:<{column}}  "
    indent = " " * len(head)
    yield from wrapped(finding.found + wanted, head, indent)
    if finding.fix:
        hint = "fix: " if not finding.ok else "hint: "
        yield from wrapped(finding.fix, indent + hint, indent)


def _verdict(report: Report) -> str:
    wrong = report.wrong
    if not wrong:
        return "All well."
    fixable = [finding.name for finding in wrong if finding.fixable]
    text = f"{len(wrong)} wrong: {', '.join(finding.name for finding in wrong)}."
    return text + (f" --fix can remedy {', '.join(fixable)}." if fixable else "")
