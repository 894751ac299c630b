"""Formats the whole report of a run (``run -v``): events, commanded values and reasons."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from haptic_wall.controller.cli.wrapping import wrapped
from haptic_wall.controller.runtime.safety import Trip

_UNCONFIRMED = (
    "the servo did not confirm that its torque is off: without a supply it has none, otherwise its "
    "Bus Watchdog ends it; switch its power off before you touch it"
)


def report_text(report: Mapping[str, Any]) -> str:
    """Format the report of ``haptic-wall run -v`` as text of some 25 lines.

    Args:
        report: The report, as for ``--json``; fields that are None are omitted.
    """
    return "\n".join(
        [
            *ending(report),
            *_timing(report),
            *_delay(report.get("delay_s")),
            *_interval(report),
            *_guard(report.get("guard")),
            *_motion(report),
            *_realtime(report.get("realtime") or []),
            *_notes(report),
        ]
    )


def ending(report: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines that say how the run ended, and explain a trip."""
    reason = str(report["stop_reason"])
    how = {"duration": "ended as planned", "interrupted": "interrupted"}.get(reason, reason)
    if trip := Trip.of(reason):
        how = f"ENDED BY A SAFETY TRIP: {trip.label}"
    log = str(report.get("log_state"))
    flaw = f", AND ITS LOG IS {log.upper()}" if log in ("incomplete", "missing") else ""
    off = report.get("torque_off")
    torque = ""
    if off is not None:
        torque = "; torque is off, read back" if off else "; TORQUE OFF COULD NOT BE READ BACK"
    if report.get("waited_for"):
        how = f"THE WALL NEVER CAME ON{flaw}: {report['waited_for']}; {how}{torque}"
    elif report.get("no_stiffness"):
        how = {"duration": "the time is over"}.get(reason, how)
        how = f"THE WALL HAS NO STIFFNESS{flaw}: {report['no_stiffness']}; {how}{torque}"
    else:
        how += flaw + torque
    yield from entry("run", how)
    if report.get("explanation"):
        yield from entry("", str(report["explanation"]))
    if off is False:
        yield from entry("", _UNCONFIRMED)


def _timing(report: Mapping[str, Any]) -> Iterator[str]:
    ticks, missed = report["ticks"], report["missed_ticks"]
    if not ticks and not missed:
        yield from entry("ticks", "none: the run ended before the wall was on")
        return
    share = f" ({100 * missed / (ticks + missed):.2f} %)" if missed else ""
    yield from entry(
        "ticks",
        f"{ticks} in {number(report['duration_s'])} s: {number(report['rate_hz'], 6)} Hz; "
        f"{missed} missed{share}",
    )
    factor = report.get("real_time_factor")
    if factor is not None:  # on the simulated clock nothing is ever late
        yield from entry("clock", f"simulated, {number(factor)} times faster than real time")
    for key, meaning in (
        ()
        if factor is not None
        else (
            ("lateness_us", "lateness"),
            ("work_us", "work"),
            ("bus_us", "bus wait"),
        )
    ):
        times = report.get(key) or {}
        if times.get("p50") is not None:
            yield from entry(meaning, _percentiles(times))
    bus = report.get("bus")
    if bus:
        refused = f", {bus['refused']} refused" if bus.get("refused") else ""
        yield from entry(
            "bus",
            f"{bus['cycles']} cycles, {bus['schedule']}: {bus['lost']} lost, {bus['late']} late, "
            f"{bus['corrupt']} corrupt{refused}; sample age {_percentiles(bus['sample_age_us'])}",
        )


def _delay(delay: Mapping[str, Any] | None) -> Iterator[str]:
    if delay:
        parts = " + ".join(
            f"{name} {milli(delay[name])}" for name in ("inserted", "device", "measured")
        )
        yield from entry("delay", f"{milli(delay['total'])} ms = {parts} ms")


def _interval(report: Mapping[str, Any]) -> Iterator[str]:
    """Yield the guard's served interval, where it is not the grid's."""
    interval = (report.get("guard") or {}).get("interval_s")
    grid = report.get("grid_hz")
    if interval and grid and interval * grid > 1.001:
        yield from entry(
            "interval",
            f"{milli(interval)} ms counted as the period: {_slower(report)}",
        )


def _slower(report: Mapping[str, Any]) -> str:
    """Describe the causes of long intervals between good readings."""
    bus = report.get("bus") or {}
    lost = sum(bus.get(name, 0) for name in ("lost", "corrupt", "refused"))
    causes = [f"{lost} replies lost or broken"] if lost else []
    if report["missed_ticks"] or not lost:
        causes.append(f"{report['missed_ticks']} ticks missed, others late")
    return ", ".join(causes)


def _guard(guard: Mapping[str, Any] | None) -> Iterator[str]:
    if not guard:
        return
    asked, commanded = guard["requested"], guard["commanded"]
    for key, unit in (("stiffness", "N·m/rad"), ("damping", "N·m·s/rad")):
        same = asked[key] == commanded[key]
        note = "as requested" if same else f"requested {number(asked[key])}"
        yield from entry(key, f"{number(commanded[key])} {unit}, {note}")
    if filtered := guard.get("velocity_filter"):
        yield from entry("filter", f"{filter_text(filtered)}, of the velocity that damps")
    limits = [
        f"{name} {number(value)}" + ("*" if name == guard["binding"] else "")
        for name, value in guard["limit"].items()
        if value is not None
    ]
    if limits:
        star = "; * binds" if guard["binding"] else ""
        ceiling = guard.get("damping_ceiling")
        above = "" if ceiling is None else f"; damping ceiling {number(ceiling)}"
        yield from entry(
            "limits", f"{', '.join(limits)} N·m/rad x margin {guard['margin']:g}{star}{above}"
        )
    for reason in guard["reasons"]:
        yield from entry("why", str(reason))
    if assumed := guard.get("assumed"):
        yield from entry("assumed", assumed)


def filter_text(filtered: Mapping[str, Any]) -> str:
    """Describe a filter of the velocity, as a report has it."""
    kind = {"lowpass": "low-pass", "notch": "notch"}[filtered["kind"]]
    return f"{kind} at {number(filtered['frequency_hz'])} Hz, quality {number(filtered['q'])}"


def _motion(report: Mapping[str, Any]) -> Iterator[str]:
    torque = report.get("torque") or {}
    if torque.get("max") is not None:
        ticks = torque["saturated_ticks"]
        cut = f"; the limit cut it in {ticks} ticks" if ticks else ""
        yield from entry("torque", f"at most {number(torque['max'])} N·m{cut}")
    if report.get("oscillation"):
        yield from entry("oscillation", oscillation(report["oscillation"]))


def oscillation(seen: Mapping[str, Any]) -> str:
    """Format the detector's state, frequency and amplitude."""
    known = [
        f"{number(seen[key])} {unit}"
        for key, unit in (("frequency_hz", "Hz"), ("amplitude_rad", "rad"))
        if seen.get(key) is not None
    ]
    return ", ".join([str(seen["state"]), *known])


def _realtime(settings: list[Mapping[str, Any]]) -> Iterator[str]:
    if settings:
        granted = [str(setting["name"]) for setting in settings if setting["ok"]]
        yield from entry(
            "real time",
            f"granted: {', '.join(granted) or 'nothing'} ({len(granted)} of {len(settings)})",
        )


def changes(report: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return label and text of each change of the running wall."""
    return [("change", _change(each)) for each in report.get("changes") or []]


def _change(change: Mapping[str, Any]) -> str:
    by, at_s = change["by"], change.get("at_s")
    when = "" if at_s is None else f"at {at_s:.3f} s, "
    text = f"{when}{' '.join(change['set'])}, by {by['user']} (process {by['pid']})"
    if change["outcome"] != "applied":
        return f"{text}: {change['outcome']}, {change['why']}"
    commanded = change.get("commanded") or {}
    waited = number(change.get("waited_s"), 2)
    return (
        f"{text}: applied after {waited} s, {number(commanded.get('stiffness'))} N·m/rad, "
        f"{number(commanded.get('damping'))} N·m·s/rad"
    )


def _notes(report: Mapping[str, Any]) -> Iterator[str]:
    for label, text in changes(report):
        yield from entry(label, text)
    for warning in report.get("warnings") or []:
        yield from entry("note", str(warning))
    yield from files(report)


def files(report: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines with the paths of log and picture; paths stay whole, to be copied."""
    for key, label in (("log", "log"), ("plot", "picture")):
        if report.get(key):
            yield f"{label:<12}{report[key]}"


def entry(label: str, text: str) -> list[str]:
    """Format a label and its text; long text wraps into the column beside the label."""
    return wrapped(text, f"{label:<12}", " " * 12)


def _percentiles(times: Mapping[str, float | None]) -> str:
    named = [
        f"{key.replace('_', '.')} {value:{'.0f' if value >= 1000 else '.3g'}}"
        for key, value in times.items()
        if value is not None
    ]
    return f"{', '.join(named)} µs" if named else "unknown"


def number(value: float | None, digits: int = 4) -> str:
    """Format a number with ``digits`` significant digits; None: unknown."""
    return "unknown" if value is None else f"{value:.{digits}g}"


def milli(seconds: float | None) -> str:
    """Format a time [s] in milliseconds, with three decimals; None: unknown."""
    return "unknown" if seconds is None else f"{1000 * seconds:.3f}"
