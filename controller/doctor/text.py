"""Formats the report of an examination."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
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
        "reached": report.reached,
    }


def text(name: str, report: Report) -> str:
    """Format the report: a line for each check, what was changed, and the verdict."""
    told, table = list(report.found.values()), _table(report.found)
    if table:  # it has the others
        told = _joined([one for one in told if "." not in one.name or not one.ok or one.fix])
    column = max((len(finding.name) for finding in told), default=0)
    lines = [f"{name}. No torque was enabled.", "", *table]
    for finding in told:
        lines += _rows(finding, column)
    if report.changes:
        lines += ["", "Changed:"]
        lines += [f"  {change}" for change in report.changes]
    lines += ["", _verdict(report)]
    return "\n".join(lines)


def _table(found: Mapping[str, Check]) -> list[str]:
    """Return a row for each check that several axes have, and a column for each axis."""
    cells = [(*name.split(".", 1), _mark(one)) for name, one in found.items() if "." in name]
    marks = {(axis, check): mark for axis, check, mark in cells}
    axes, checks = (
        dict.fromkeys(axis for axis, *_ in cells),
        dict.fromkeys(one for _, one, _ in cells),
    )
    if not axes:
        return []
    column = max(map(len, checks))
    lines = [" " * column + "".join(f"  {axis:>5}" for axis in axes)]
    for check in checks:
        row = (f"  {marks.get((axis, check), ''):>{max(5, len(axis))}}" for axis in axes)
        lines.append(f"{check:<{column}}" + "".join(row))
    return [*lines, ""]


def _joined(told: list[Check]) -> list[Check]:
    """Make one of equal findings of several axes."""
    axes: dict[Check, list[str]] = {}
    for one in told:
        axis, dot, check = one.name.rpartition(".")
        axes.setdefault(replace(one, name=check), []).extend([axis] if dot else [])
    return [
        replace(one, found=f"{', '.join(names)}: {one.found}" if names else one.found)
        for one, names in axes.items()
    ]


def _mark(finding: Check) -> str:
    return "WRONG" if not finding.ok else "-" if not finding.applies else "ok"


def _rows(finding: Check, column: int) -> Iterator[str]:
    mark = _mark(finding)
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
