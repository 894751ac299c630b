"""Formats a log's summary in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from haptic_wall.controller.cli.text import entry
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.system.printable import in_line


def config_line(config: object) -> str:
    """Describe the run in one line, from the log's configuration, whatever it contains."""
    servo, wall, loop = (_section(config, name) for name in ("servo", "wall", "loop"))
    return (
        f"{_value(servo, 'backend')} servo, wall {_value(wall, 'side')} "
        f"{_value(wall, 'position')} rad"
        f"{' from the start' if wall.get('reference') == 'start' else ''}, "
        f"K {_value(wall, 'stiffness')} N·m/rad, "
        f"B {_value(wall, 'damping')} N·m·s/rad requested, "
        f"{_value(loop, 'rate_hz')} Hz"
    )


def _section(config: object, name: str) -> Mapping[str, Any]:
    section = config.get(name) if isinstance(config, dict) else None
    return section if isinstance(section, dict) else {}


def _value(section: Mapping[str, Any], name: str) -> str:
    value = section.get(name)
    return in_line(str(value), 40) if isinstance(value, str | int | float) else "unknown"


def summary_text(summary: Mapping[str, Any], log: str) -> str:
    """Format the summary as text of some ten lines.

    Args:
        summary: The summary, as for ``--json``.
        log: The name of the log.
    """
    return "\n".join(_lines(summary, log))


def _lines(summary: Mapping[str, Any], log: str) -> Iterator[str]:
    name, program = (
        in_line(summary[key]) if isinstance(summary[key], str) else "unknown"
        for key in ("name", "program")
    )
    yield f"run         {name} ({program})"
    yield f"config      {summary['config']}"
    if not summary["rows"]:
        yield "rows        none"
        return
    rate = "unknown" if summary["rate_hz"] is None else f"{summary['rate_hz']:.6g} Hz"
    since = f", from {summary['from_s']:.6g} s on" if summary["from_s"] > 0.0 else ""
    yield f"rows        {summary['rows']} in {summary['duration_s']:.6g} s: {rate}{since}"
    yield (
        f"lost        {summary['missed_ticks']} missed ticks, {summary['failed_readings']} "
        f"failed readings, {summary['unrecorded_rows']} rows not recorded"
    )
    yield from _what_happened(summary)
    yield f"ended       {_ended(summary, log)}"
    if summary["schedule"]:
        yield f"schedule    {in_line(summary['schedule'])}"
    for label, texts in (
        ("why", (summary["guard"] or {}).get("reasons") or []),
        ("note", summary["warnings"]),
    ):
        for text in texts:
            yield from entry(label, in_line(text, 1000))


def _what_happened(summary: Mapping[str, Any]) -> Iterator[str]:
    off = summary["off_ticks"]
    on = summary["rows"] - summary["warm_up_ticks"] - off
    if on == 0:
        yield "wall        never on"
    else:
        contact = 100.0 * summary["contact_ticks"] / on
        warm_up = summary["warm_up_ticks"]
        before = f", after {warm_up} of warm-up" if warm_up else ""
        between = f", off for {off}" if off else ""
        ticks = f"{on} ticks{before}{between}"
        yield f"wall        on for {ticks}; in contact for {contact:.3g} % of them"
    yield from _changes(summary["changes"])
    if summary["phases"] > 1:
        yield f"phases      {summary['phases']} of an experiment's program"
    yield f"position    {_span(summary['position_rad'])} rad"
    cut = summary["saturated_ticks"]
    limit = f"; the limit cut it in {cut} ticks" if cut else ""
    yield f"torque      {_span(summary['torque_nm'])} N·m{limit}"
    oscillation = summary["oscillation"]
    first = oscillation["first_s"]
    when = "" if first is None else f", first at {first:.6g} s, for {oscillation['ticks']} ticks"
    yield f"oscillation {oscillation['state'] or 'not watched'}{when}"
    late = summary["lateness_us"]
    if late["max"]:  # on the simulated clock nothing is ever late
        yield (
            f"lateness    p50 {late['p50']:.3g}, p99 {late['p99']:.3g}, "
            f"largest {late['max']:.4g} µs"
            f" at {late['max_at_s']:.6g} s"
        )


def _changes(changes: Mapping[str, Any]) -> Iterator[str]:
    """Describe the changes of the running wall, the last one with its user."""
    if not changes["count"]:
        return
    last = changes["last"][-1]
    by, sets = last.get("by"), last.get("set")
    user = by.get("user") if isinstance(by, dict) else None
    asked = " ".join(map(str, sets)) if isinstance(sets, list) else "unknown"
    yield (
        f"changes     {changes['count']} requested; the last: {in_line(asked, 80)}, by "
        f"{in_line(str(user), 40)}: {in_line(str(last.get('outcome')), 40)}"
    )


def _ended(summary: Mapping[str, Any], log: str) -> str:
    reason = summary["stop_reason"]
    if reason is None:
        return f"not recorded in {log}: the run goes on, or was killed"
    how = {"duration": "as planned", "interrupted": "interrupted"}.get(reason, in_line(reason))
    if trip := Trip.of(reason):
        how = f"BY A SAFETY TRIP: {trip.label}"
    return f"{how} ({in_line(summary['message'], 1000)})" if summary["message"] else how


def _span(extremes: list[float] | None) -> str:
    return "unknown" if extremes is None else "{:.4g} to {:.4g}".format(*extremes)
