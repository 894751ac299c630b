"""Formats the report of a run: in short, or in full (``run -v``)."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from haptic_wall.controller.live.log_events import change_text
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.system.wrapping import wrapped

_WITHOUT_END = ("incomplete", "missing")
"""States of a log that may lack the report"""
_UNCONFIRMED = (
    "the servo did not confirm that its torque is off: without a supply it has none, otherwise its "
    "Bus Watchdog ends it; switch its power off before you touch it"
)
Lines = Iterator[tuple[str, str]]
"""Labels and texts"""


def report_text(report: Mapping[str, Any], *, brief: bool = False) -> str:
    """Format the report of ``haptic-wall run`` in some 25 lines, or in about eight.

    The brief one has the guard's first reason and the last note; its line ``more`` counts the
    others, which the log has. Without a log that has them the report is not brief.

    Args:
        report: The report, as for ``--json``; fields that are None are omitted.
        brief: In about eight lines.
    """
    notes, changes = report.get("warnings") or [], report.get("changes") or []
    reasons = [text for _, text in _of_guards(report, _reasons)]
    told = [*_ending(report), *_motion(report)]
    told += _axes(report) if report.get("axes") else _wall(report)
    if brief and str(report.get("log_state")) not in _WITHOUT_END:
        others = (len(notes) - 1, "note"), (len(changes), "change"), (len(reasons) - 1, "reason")
        more = [f"{count} {what}{'s' * (count > 1)}" for count, what in others if count > 0]
        log = report.get("log")
        where = f"haptic-wall log {shlex.quote(str(log))}" if log else "run -v"
        told += [("why", text) for text in reasons[:1]]
        told += [*_ticks(report), *_bus(report)]
        told += [("note", text) for text in notes[-1:]]
        told += [("more", f"{', '.join(more)}: `{where}`")] if more else []
    else:
        told += _of_guards(report, _limits)
        told += [*_ticks(report), *_timing(report), *_bus(report)]
        told += [*_delay(report), *_realtime(report.get("realtime"))]
        told += [("why", text) for text in reasons]
        told += [("change", _change(each)) for each in changes]
        told += [("note", text) for text in notes]
    lines = [line for label, text in told for line in entry(label, str(text))]
    files = (("log", "log"), ("plot", "picture"))  # whole, to be copied
    lines += [f"{label:<12}{report[key]}" for key, label in files if report.get(key)]
    return "\n".join(lines)


def _ending(report: Mapping[str, Any]) -> Lines:
    """Say how the run ended, and explain a trip."""
    reason = str(report["stop_reason"])
    how = {"duration": "ended as planned", "interrupted": "interrupted"}.get(reason, reason)
    if trip := Trip.of(reason):
        of = f" of {report['stop_axis']}" if report.get("stop_axis") else ""
        how = f"ENDED BY A SAFETY TRIP: {trip.label}{of}"
    log = str(report.get("log_state"))
    flaw = f", AND ITS LOG IS {log.upper()}" if log in _WITHOUT_END else ""
    off = report.get("torque_off")
    torque = ""
    if off is not None:
        torque = "; torque is off, read back" if off else "; TORQUE OFF COULD NOT BE READ BACK"
    if report.get("waited_for"):
        how = f"THE WALL NEVER CAME ON{flaw}: {report['waited_for']}; {how}"
    elif report.get("no_stiffness"):
        how = {"duration": "the time is over"}.get(reason, how)
        how = f"THE WALL HAS NO STIFFNESS{flaw}: {report['no_stiffness']}; {how}"
    else:
        how += flaw
    yield "run", how + torque
    if report.get("explanation"):
        yield "", str(report["explanation"])
    if off is False:
        yield "", _UNCONFIRMED


def _parts(report: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    """Return the part on each axis, by its name; of one servo it is the report itself."""
    return list((report.get("axes") or {"": report}).items())


def _of_guards(
    report: Mapping[str, Any], lines: Callable[[Mapping[str, Any] | None], Lines]
) -> Lines:
    """Yield lines on each axis's guard; what holds for some of the axes only begins with those."""
    parts, told = _parts(report), dict[tuple[str, str], list[str]]()
    for name, part in parts:
        for line in lines(part.get("guard")):
            told.setdefault(line, []).append(name)
    for (label, text), names in told.items():
        yield label, text if len(names) == len(parts) else f"{', '.join(names)}: {text}"


def _reasons(guard: Mapping[str, Any] | None) -> Lines:
    for text in (guard or {}).get("reasons") or []:
        yield "why", str(text)


def _axes(report: Mapping[str, Any]) -> Lines:
    """Say in a line for each axis what it commanded, and what it saw."""
    for name, part in _parts(report):
        said = [text for _, text in (*_wall(part), *_motion(part))]
        bus = part.get("bus") or {}
        said += [f"{bus[kind]} {kind}" for kind in ("lost", "corrupt", "refused") if bus.get(kind)]
        yield "axis", f"{name}: {'; '.join(said)}"


def _motion(report: Mapping[str, Any]) -> Lines:
    seen, torque, parts = report.get("oscillation"), report.get("torque") or {}, []
    if seen:
        parts = [seen["state"]]
        for key, unit in (("frequency_hz", "Hz"), ("amplitude_rad", "rad")):
            if seen.get(key) is not None:
                parts[0] += f", {number(seen[key])} {unit}"
        if seen.get("first_alarm_s") is not None:
            parts.append(f"alarm after {number(seen['first_alarm_s'])} s")
        if (probes := seen.get("probes")) or seen.get("probed_s"):  # axes share a probe
            times = f"{probes} probe{'s' * (probes > 1)}" if probes else "no probe of its own"
            parts.append(f"{times}, wall softer for {number(seen.get('probed_s'), 2)} s")
        if (share := _left(report)) < 1.0:
            parts.append(f"wall reduced to {100.0 * share:.0f} %")
    if torque.get("max") is not None:
        ticks = torque["saturated_ticks"]
        cut = f", the limit cut it in {ticks} ticks" if ticks else ""
        parts.append(f"torque at most {number(torque['max'])} N·m{cut}")
    if parts:
        yield "oscillation" if seen else "torque", "; ".join(parts)


def _left(report: Mapping[str, Any]) -> float:
    """Return the share of the stiffness that alarms have left."""
    reduced = (report.get("oscillation") or {}).get("reduced_to") or {}
    return float(reduced.get("stiffness", 1.0))


def _wall(report: Mapping[str, Any]) -> Lines:
    if not (guard := report.get("guard")):
        return
    asked, commanded = guard["requested"], guard["commanded"]
    parts = []
    for key, unit in (("stiffness", "N·m/rad"), ("damping", "N·m·s/rad")):
        of = "" if asked[key] == commanded[key] else f" of {number(asked[key])} requested"
        parts.append(f"{number(commanded[key])} {unit}{of}")
    if report.get("wall_came_on") is False:
        parts.append("was never on")
    elif _left(report) < 1.0:
        parts.append("reduced after an oscillation")
    elif guard["binding"]:
        parts.append(f"limited by {guard['binding']}")
    elif asked == commanded:
        parts.append("as requested")
    yield "wall", ", ".join(parts)


def _limits(guard: Mapping[str, Any] | None) -> Lines:
    if not guard:
        return
    if filtered := guard.get("velocity_filter"):
        yield "filter", f"{filter_text(filtered)}, of the velocity that damps"
    limits = [
        f"{name} {number(value)}" + ("*" if name == guard["binding"] else "")
        for name, value in guard["limit"].items()
        if value is not None
    ]
    if limits:
        star = "; * binds" if guard["binding"] else ""
        ceiling = guard.get("damping_ceiling")
        above = "" if ceiling is None else f"; damping ceiling {number(ceiling)}"
        yield "limits", f"{', '.join(limits)} N·m/rad x margin {guard['margin']:g}{star}{above}"
    if assumed := guard.get("assumed"):
        yield "assumed", str(assumed)


def _ticks(report: Mapping[str, Any]) -> Lines:
    ticks, missed = report["ticks"], report["missed_ticks"]
    if not ticks and not missed:
        yield "ticks", "none: the run ended before the wall was on"
        return
    share = f"{100 * missed / (ticks + missed):.2g} %" if missed else "none"
    parts = [f"{ticks} at {number(report['rate_hz'])} Hz, {share} missed"]
    late = report.get("lateness_us") or {}
    if report.get("real_time_factor") is not None:
        parts.append("simulated clock")
    elif late.get("max") is not None:
        parts.append(f"late by p99 {_micro(late['p99'])}, max {late['max']:.0f} µs")
    if report.get("delay_s"):
        parts.append(f"delay {milli(report['delay_s']['total'])} ms")
    yield "ticks", "; ".join(parts)


def _timing(report: Mapping[str, Any]) -> Lines:
    factor = report.get("real_time_factor")
    if factor is not None:  # on the simulated clock nothing is ever late
        yield "clock", f"simulated, {number(factor)} times faster than real time"
        return
    for key, meaning in (("lateness_us", "lateness"), ("work_us", "work"), ("bus_us", "bus wait")):
        named = [
            f"{name.replace('_', '.')} {_micro(time)}"
            for name, time in (report.get(key) or {}).items()
            if time is not None
        ]
        if named:
            yield meaning, f"{', '.join(named)} µs"


def _micro(time: float) -> str:
    """Return microseconds, without an exponent."""
    return f"{time:{'.0f' if time >= 1000 else '.3g'}}"


def _bus(report: Mapping[str, Any]) -> Lines:
    if bus := report.get("bus"):
        kinds = ["lost", "late", "corrupt", *(["refused"] if bus.get("refused") else [])]
        counts = ", ".join(f"{bus[kind]} {kind}" for kind in kinds)
        age = bus["sample_age_us"].get("p99")
        known = "" if age is None else f"; sample age p99 {age:.0f} µs"
        what = f"readings of {len(report['axes'])} servos" if report.get("axes") else "cycles"
        yield "bus", f"{bus['cycles']} {what}, {bus['schedule']}: {counts}{known}"


def _delay(report: Mapping[str, Any]) -> Lines:
    """Say the parts of the delay, and the guard's served interval where it is not the grid's."""
    if delay := report.get("delay_s"):
        names = ("inserted", "device", "measured")
        parts = " + ".join(f"{name} {milli(delay[name])}" for name in names)
        yield "delay", f"{milli(delay['total'])} ms = {parts} ms"
    interval, grid = (report.get("guard") or {}).get("interval_s"), report.get("grid_hz")
    if interval and grid and interval * grid > 1.001:
        yield (
            "interval",
            f"{milli(interval)} ms counted as the period: ticks or replies were late",
        )


def _realtime(settings: list[Mapping[str, Any]] | None) -> Lines:
    if settings:
        granted = [str(setting["name"]) for setting in settings if setting["ok"]]
        names = ", ".join(granted) or "nothing"
        yield "real time", f"granted: {names} ({len(granted)} of {len(settings)})"


def _change(change: Mapping[str, Any]) -> str:
    """Describe a change of the running wall."""
    at_s = change.get("at_s")
    return ("" if at_s is None else f"at {at_s:.3f} s, ") + change_text(change)


def filter_text(filtered: Mapping[str, Any]) -> str:
    """Describe a filter of the velocity, as a report has it."""
    kind = {"lowpass": "low-pass", "notch": "notch"}[filtered["kind"]]
    return f"{kind} at {number(filtered['frequency_hz'])} Hz, quality {number(filtered['q'])}"


def entry(label: str, text: str) -> list[str]:
    """Format a label and its text; long text wraps into the column beside the label."""
    return wrapped(text, f"{label:<12}", " " * 12)


def number(value: float | None, digits: int = 4) -> str:
    """Format a number with ``digits`` significant digits; None: unknown."""
    return "unknown" if value is None else f"{value:.{digits}g}"


def milli(seconds: float | None) -> str:
    """Format a time [s] in milliseconds, with three decimals; None: unknown."""
    return "unknown" if seconds is None else f"{1000 * seconds:.3f}"
