"""The report of a run as readable text: what happened, what was commanded and why."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

_WIDTH = 98
_WORST = 3
"""How many of the worst ticks the text names"""
_LIMITS = ("linear", "exact", "one_sided", "quantisation", "passive")
_UNCONFIRMED = (
    "the servo did not answer when its torque was switched off: without a supply it has none, and "
    "else its Bus Watchdog ends it; switch its power off before you reach for it"
)


def report_text(report: Mapping[str, Any]) -> str:
    """The report of ``haptic-wall run`` as text of some 25 lines.

    Args:
        report: As the command's ``--json`` gives it; what is None is left out.
    """
    return "\n".join(
        [
            *_ending(report),
            *_timing(report),
            *_delay(report.get("delay_s")),
            *_interval(report),
            *_guard(report.get("guard")),
            *_motion(report),
            *_realtime(report.get("realtime") or []),
            *_notes(report),
        ]
    )


def _ending(report: Mapping[str, Any]) -> Iterator[str]:
    reason = str(report["stop_reason"])
    how = {"duration": "ended as planned", "interrupted": "interrupted"}.get(reason, reason)
    if reason.startswith("trip:"):
        how = f"ENDED BY A SAFETY TRIP: {reason.removeprefix('trip:')}"
    log = str(report.get("log_state"))
    flaw = f", AND ITS LOG IS {log.upper()}" if log in ("incomplete", "missing") else ""
    off = report.get("torque_off")
    torque = ""
    if off is not None:
        torque = "; torque is off, read back" if off else "; TORQUE OFF COULD NOT BE READ BACK"
    if report.get("waited_for"):
        how = f"THE WALL NEVER CAME ON{flaw}: {report['waited_for']}; {how}{torque}"
    else:
        how += flaw + torque
    yield from _entry("run", how)
    if report.get("explanation"):
        yield from _entry("", str(report["explanation"]))
    if off is False:
        yield from _entry("", _UNCONFIRMED)


def _timing(report: Mapping[str, Any]) -> Iterator[str]:
    ticks, missed = report["ticks"], report["missed_ticks"]
    if not ticks and not missed:
        yield from _entry("ticks", "none: it ended before the wall was on")
        return
    share = f" ({100 * missed / (ticks + missed):.2f} %)" if missed else ""
    yield from _entry(
        "ticks",
        f"{ticks} in {_number(report['duration_s'])} s: {_number(report['rate_hz'], 6)} Hz; "
        f"{missed} missed{share}",
    )
    factor = report.get("real_time_factor")
    if factor is not None:  # on the simulated clock nothing is ever late
        yield from _entry("clock", f"simulated, {_number(factor)} times faster than real time")
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
            yield from _entry(meaning, _percentiles(times))
    yield from _late(report.get("timing"))
    bus = report.get("bus")
    if bus:
        refused = f", {bus['refused']} refused" if bus.get("refused") else ""
        yield from _entry(
            "bus",
            f"{bus['cycles']} cycles: {bus['lost']} lost, {bus['late']} late, "
            f"{bus['corrupt']} corrupt{refused}; sample age {_percentiles(bus['sample_age_us'])}",
        )


def _late(timing: Mapping[str, Any] | None) -> Iterator[str]:
    """How many ticks were late and why, and the worst of them."""
    if not timing or not timing["late_ticks"]:
        return
    causes = sorted(timing["causes"].items(), key=lambda item: -item[1])
    yield from _entry(
        "late ticks",
        f"{timing['late_ticks']} by more than {_number(timing['limit_us'])} µs: "
        + ", ".join(f"{cause} {count}" for cause, count in causes),
    )
    for place, tick in enumerate(timing["worst"][:_WORST]):
        lost = f"{tick['missed']} missed" if tick["missed"] else "none missed"
        whole_ms = (tick["lateness_us"] + tick["work_us"] + tick["bus_us"]) / 1000.0
        why = f"{tick['cause']} ({tick['evidence']})" if tick["evidence"] else tick["cause"]
        yield from _entry(
            "" if place else "worst ticks",
            f"{_number(whole_ms, 3)} ms, {lost}, at {_number(tick['time_s'])} s: {why}",
        )


def _delay(delay: Mapping[str, Any] | None) -> Iterator[str]:
    if delay:
        parts = " + ".join(
            f"{name} {_milli(delay[name])}" for name in ("inserted", "device", "measured")
        )
        yield from _entry("delay", f"{_milli(delay['total'])} ms = {parts} ms")


def _interval(report: Mapping[str, Any]) -> Iterator[str]:
    """The interval that the guard counted as the period, where it is not the grid's."""
    interval = (report.get("guard") or {}).get("interval_s")
    grid = report.get("grid_hz")
    if interval and grid and interval * grid > 1.001:
        yield from _entry(
            "interval",
            f"{_milli(interval)} ms counted as the period: {_slower(report)}",
        )


def _slower(report: Mapping[str, Any]) -> str:
    """What lay between one good reading and the next."""
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
        note = "as requested" if same else f"requested {_number(asked[key])}"
        yield from _entry(key, f"{_number(commanded[key])} {unit}, {note}")
    limits = [
        f"{name} {_number(guard['limit'][name])}"
        + ("*" if name == guard["binding"] and guard["binding"] else "")
        for name in _LIMITS
        if guard["limit"].get(name) is not None
    ]
    if limits:
        star = "; * binds" if guard["binding"] else ""
        ceiling = guard.get("damping_ceiling")
        above = "" if ceiling is None else f"; damping ceiling {_number(ceiling)}"
        yield from _entry(
            "limits", f"{', '.join(limits)} N·m/rad x margin {guard['margin']:g}{star}{above}"
        )
    high = guard.get("rebound_speed_high")
    if high is not None:
        yield from _entry("rebound", _rebound(guard["rebound_speed"], high))
    for reason in guard["reasons"]:
        yield from _entry("why", str(reason))


def _rebound(low: float | None, high: float) -> str:
    """For which speeds of entry the device is guaranteed to come back no faster."""
    least = 0.0 if low is None else low
    if least >= high:
        return "at no speed is the device guaranteed to come back no faster than it came"
    span = f"up to {_number(high)}" if low is None else f"from {_number(low)} to {_number(high)}"
    return f"no faster than it came, for speeds {span} rad/s"


def _motion(report: Mapping[str, Any]) -> Iterator[str]:
    torque = report.get("torque") or {}
    if torque.get("max") is not None:
        ticks = torque["saturated_ticks"]
        cut = f"; the limit cut it in {ticks} ticks" if ticks else ""
        yield from _entry("torque", f"at most {_number(torque['max'])} N·m{cut}")
    oscillation = report.get("oscillation")
    if oscillation:
        known = [
            f"{_number(oscillation[key])} {unit}"
            for key, unit in (("frequency_hz", "Hz"), ("amplitude_rad", "rad"))
            if oscillation.get(key) is not None
        ]
        yield from _entry("oscillation", ", ".join([str(oscillation["state"]), *known]))


def _realtime(settings: list[Mapping[str, Any]]) -> Iterator[str]:
    if settings:
        granted = [str(setting["name"]) for setting in settings if setting["ok"]]
        yield from _entry(
            "real time",
            f"granted: {', '.join(granted) or 'nothing'} ({len(granted)} of {len(settings)})",
        )


def _notes(report: Mapping[str, Any]) -> Iterator[str]:
    for warning in report.get("warnings") or []:
        yield from _entry("note", str(warning))
    for key, label in (("log", "log"), ("plot", "picture")):
        if report.get(key):
            # A path is one word for whoever copies it: never folded.
            yield f"{label:<12}{report[key]}"


def _entry(label: str, text: str) -> list[str]:
    """A label and its text, folded under itself."""
    return textwrap.wrap(
        text,
        _WIDTH,
        initial_indent=f"{label:<12}",
        subsequent_indent=" " * 12,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _percentiles(times: Mapping[str, float | None]) -> str:
    named = [
        f"{key.replace('_', '.')} {value:{'.0f' if value >= 1000 else '.3g'}}"
        for key, value in times.items()
        if value is not None
    ]
    return f"{', '.join(named)} µs" if named else "unknown"


def _number(value: float | None, digits: int = 4) -> str:
    return "unknown" if value is None else f"{value:.{digits}g}"


def _milli(seconds: float | None) -> str:
    return "unknown" if seconds is None else f"{1000 * seconds:.3f}"
