"""Formats the report of an examination."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from haptic_wall.controller.doctor.report import Report
from haptic_wall.controller.system.wrapping import wrapped
from haptic_wall.hw.servo import Check


def as_data(name: str, report: Report) -> dict[str, Any]:
    """Return the report as JSON-ready values."""
    return {
        "name": name,
        "checks": [asdict(finding) for finding in report.found.values()],
        "changes": [change._asdict() for change in report.changes],
        "not_examined": report.not_examined,
        "reached": report.reached,
        "suits": report.suits,
    }


def text(name: str, report: Report) -> str:
    """Format the report: a line for each check, what was changed, and the verdict."""
    column = max((len(finding.name) for finding in report.found.values()), default=0)
    lines = [f"{name}. No torque was enabled.", ""]
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
