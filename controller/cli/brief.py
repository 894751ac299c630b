"""Formats the report of a run in eight lines; ``haptic_wall.controller.cli.text``: in full."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any, Final

from haptic_wall.controller.cli.text import (
    changes,
    ending,
    entry,
    files,
    milli,
    number,
    oscillation,
)

LINES: Final = 8
_WIDEST: Final = "9 notes, 9 reasons"


def brief_text(report: Mapping[str, Any]) -> str:
    """Format the report of ``haptic-wall run`` in eight lines.

    There are more lines only for a trip's explanation, a torque that could not be read back, and
    the first reason of the guard: each stands whole. The line ``more`` counts what is omitted.

    Args:
        report: The report, as for ``--json``; None is omitted.
    """
    ended, places = list(ending(report)), list(files(report))
    notes = [("note", str(note)) for note in report.get("warnings") or []]
    guard = report.get("guard") or {}
    reasons = [("why", str(why)) for why in guard.get("reasons") or []]
    more = [*notes, *changes(report), *reasons[1:]]
    log = report.get("log")
    where = f": `haptic-wall log {shlex.quote(str(log))}`" if log else ": `run -v`"
    room = LINES - len(ended) - len(places) - (len(entry("more", _WIDEST + where)) if more else 0)
    lines: list[str] = []
    for fact in (_oscillation(report), _wall(guard), _ticks(report), _bus(report)):
        lines += fact if len(fact) <= room - len(lines) else []
    if reasons:
        at = next((i + 1 for i, line in enumerate(lines) if line.startswith("wall ")), 0)
        lines[at:at] = why = entry(*reasons[0])
        room += len(why)
    cut = []
    for label, text in more:
        whole = entry(label, text)
        if len(whole) <= room - len(lines):
            lines += whole
        else:
            cut.append(label)
    if cut:
        said = (
            _count(cut.count("note"), "note"),
            _count(cut.count("change"), "change"),
            _count(cut.count("why"), "reason"),
        )
        lines += entry("more", ", ".join(filter(None, said)) + where)
    return "\n".join([*ended, *lines, *places])


def _oscillation(report: Mapping[str, Any]) -> list[str]:
    seen = report.get("oscillation")
    if not seen:
        return []
    torque = (report.get("torque") or {}).get("max")
    first = seen.get("first_alarm_s")
    share = (seen.get("reduced_to") or {}).get("stiffness", 1.0)
    parts = [
        oscillation(seen),
        *([] if first is None else [f"alarm after {number(first)} s"]),
        *([f"wall reduced to {100.0 * share:.0f} %"] if share < 1.0 else []),
        *([] if torque is None else [f"torque at most {number(torque)} N·m"]),
    ]
    return entry("oscillation", "; ".join(parts))


def _wall(guard: Mapping[str, Any] | None) -> list[str]:
    if not guard:
        return []
    asked, commanded = guard["requested"], guard["commanded"]
    parts = []
    for key, unit in (("stiffness", "N·m/rad"), ("damping", "N·m·s/rad")):
        same = asked[key] == commanded[key]
        part = f"{number(commanded[key])} {unit}"
        parts.append(part if same else f"{part} of {number(asked[key])} requested")
    if guard["binding"]:
        parts.append(f"limited by {guard['binding']}")
    elif asked == commanded:
        parts.append("as requested")
    return entry("wall", ", ".join(parts))


def _ticks(report: Mapping[str, Any]) -> list[str]:
    ticks, missed = report["ticks"], report["missed_ticks"]
    if not ticks and not missed:
        return entry("ticks", "none: the run ended before the wall was on")
    share = f"{100 * missed / (ticks + missed):.2g} %" if missed else "none"
    parts = [f"{ticks} at {number(report['rate_hz'])} Hz, {share} missed"]
    late = report.get("lateness_us") or {}
    if report.get("real_time_factor") is not None:
        parts.append("simulated clock")
    elif late.get("max") is not None:
        parts.append(f"late by p99 {late['p99']:.3g}, max {late['max']:.0f} µs")
    if report.get("delay_s"):
        parts.append(f"delay {milli(report['delay_s']['total'])} ms")
    return entry("ticks", "; ".join(parts))


def _bus(report: Mapping[str, Any]) -> list[str]:
    bus = report.get("bus")
    if not bus:
        return []
    counts = ", ".join(f"{bus[key]} {key}" for key in ("lost", "late", "corrupt"))
    age = bus["sample_age_us"].get("p99")
    known = "" if age is None else f"; sample age p99 {age:.0f} µs"
    return entry("bus", f"{bus['cycles']} cycles, {bus['schedule']}: {counts}{known}")


def _count(count: int, what: str) -> str:
    return f"{count} {what}{'s' if count > 1 else ''}" if count else ""
