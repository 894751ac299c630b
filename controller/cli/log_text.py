"""A log's summary in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any


def config_line(config: Mapping[str, Any]) -> str:
    """What was run, in a line, from the log's configuration."""
    servo, wall = config.get("servo", {}), config.get("wall", {})
    return (
        f"{servo.get('backend', 'unknown')} servo, wall {wall.get('side', 'unknown')} "
        f"{wall.get('position', 'unknown')} rad"
        f"{' from the start' if wall.get('reference') == 'start' else ''}, "
        f"K {wall.get('stiffness', 'unknown')} N·m/rad, "
        f"B {wall.get('damping', 'unknown')} N·m·s/rad asked, "
        f"{config.get('loop', {}).get('rate_hz', 'unknown')} Hz"
    )


def summary_text(summary: Mapping[str, Any], cut: Mapping[str, Any] | None, log: str) -> str:
    """The summary as text of some ten lines.

    Args:
        summary: As the command's ``--json`` gives it.
        cut: Where the log was cut from; None: it is a run's own.
        log: Its name.
    """
    return "\n".join(_lines(summary, cut, log))


def _lines(summary: Mapping[str, Any], cut: Mapping[str, Any] | None, log: str) -> Iterator[str]:
    yield f"run         {summary['name']} ({summary['program']})"
    yield f"config      {summary['config']}"
    if cut is not None:
        yield f"cut         from {cut['log']}, {cut['from_s']:.6g} to {cut['to_s']:.6g} s"
    if not summary["rows"]:
        yield "rows        none"
        yield from _damage(summary["damaged"])
        return
    rate = "unknown" if summary["rate_hz"] is None else f"{summary['rate_hz']:.6g} Hz"
    since = f", from {summary['from_s']:.6g} s on" if summary["from_s"] > 0.0 else ""
    yield f"rows        {summary['rows']} in {summary['duration_s']:.6g} s: {rate}{since}"
    yield (
        f"lost        {summary['missed_ticks']} missed ticks, {summary['failed_readings']} "
        f"failed readings, {summary['unrecorded_rows']} rows not recorded"
    )
    yield from _damage(summary["damaged"])
    yield from _what_happened(summary)
    yield f"ended       {_ended(summary, log)}"


def _damage(damaged: Mapping[str, Any]) -> Iterator[str]:
    if not damaged["places"]:
        return
    if damaged["places"] == 1 and damaged["cut_off"]:
        yield f"cut off     the last {damaged['bytes']} bytes are not a whole block"
        return
    rows = "some rows" if damaged["rows"] is None else f"{damaged['rows']} rows"
    places = "1 place" if damaged["places"] == 1 else f"{damaged['places']} places"
    yield f"damaged     {damaged['bytes']} bytes in {places}: {rows} lost, the others are intact"


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
    if summary["phases"] > 1:
        yield f"phases      {summary['phases']} of an experiment's program"
    yield f"position    {_span(summary['position_rad'])} rad"
    cut = summary["saturated_ticks"]
    limit = f"; the limit cut it in {cut} ticks" if cut else ""
    yield f"torque      {_span(summary['torque_nm'])} N·m{limit}"
    oscillation = summary["oscillation"]
    first = oscillation["first_s"]
    when = "" if first is None else f", first at {first:.6g} s, for {oscillation['ticks']} ticks"
    yield f"oscillation {oscillation['state']}{when}"
    late = summary["lateness_us"]
    if late["max"]:  # on the simulated clock nothing is ever late
        yield (
            f"lateness    p50 {late['p50']:.3g}, p99 {late['p99']:.3g}, "
            f"largest {late['max']:.4g} µs"
            f" at {late['max_at_s']:.6g} s"
        )


def _ended(summary: Mapping[str, Any], log: str) -> str:
    reason = summary["stop_reason"]
    if reason is None:
        return f"not told in {log}: the run goes on, was killed, or this is a part of it"
    how = {"duration": "as planned", "interrupted": "interrupted"}.get(reason, reason)
    if reason.startswith("trip:"):
        how = f"BY A SAFETY TRIP: {reason.removeprefix('trip:')}"
    return f"{how} ({summary['message']})" if summary["message"] else how


def _span(extremes: list[float] | None) -> str:
    return "unknown" if extremes is None else "{:.4g} to {:.4g}".format(*extremes)
