"""Judges each prediction of an acceptance by its measurement; adds the emulated servo's value."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from haptic_wall.controller.experiments.acceptance.predictions import at_kick
from haptic_wall.controller.experiments.commission.sequence import Ended

_ERRORS = 2.0
"""Standard errors within which a prediction holds"""
HOLDS, FAILS, OBSERVED, MISSING = "holds", "does not hold", "observed", "not measured"
_PARAMETERS = {
    "inertia": ("inertia", "kg·m²"),
    "damping": ("viscous friction", "N·m·s/rad"),
    "coulomb": ("Coulomb friction", "N·m"),
    "delay": ("delay of the servo, by its motions", "s"),
    "torque_gain": ("torque gain", ""),
    "backlash": ("backlash", "rad"),
}
_DEVICE = "delay of the servo, by further runs"

Figure = dict[str, float | None]
"""``value``, ``stderr``, and ``kick_rad``: the amplitude for which a limit holds"""


def rows(predictions: Mapping[str, Any], real: Ended, twin: Ended) -> list[dict[str, Any]]:
    """Return every assumption with its prediction and its measurements.

    Args:
        predictions: As they were written before.
        real: The servo of CONFIG.
        twin: The emulated servo.

    Returns:
        For each ``name, unit, step, low, high`` (predicted; null: nothing was), ``real`` and
        ``emulated`` (null: not measured), ``verdict`` and ``note``.
    """
    here, there = dict(_figures(real)), dict(_figures(twin))
    swept = real.data("sweep")
    why = {_limit_name(point): _why(point) for point in (swept["points"] if swept else ())}
    ended = real.outcomes.get("sweep")
    early = f"the sweep ended before: {ended.reason}" if ended and ended.reason else None
    found = []
    for name, unit, step, wanted in _predicted(predictions):
        figure, beside = here.get(name), there.get(name)
        bounds: Mapping[str, Any] | None = wanted
        note = why.get(name, early) if step == "sweep" else None
        if step == "sweep":
            kicks = (each["kick_rad"] for each in (figure, beside) if each is not None)
            kick = next(filter(None, kicks), None)
            bounds = None if kick is None else at_kick(wanted, kick)
        verdict = _verdict(figure, bounds)
        if verdict == FAILS and step == "sweep" and figure and bounds:
            note = "; ".join(filter(None, (_side(figure, bounds), note)))
        if figure is not None or beside is not None or note:
            low, high = (bounds["low"], bounds["high"]) if bounds else (None, None)
            row = {"name": name, "unit": unit, "step": step, "low": low, "high": high}
            more = {"real": figure, "emulated": beside, "verdict": verdict, "note": note}
            found.append(row | more)
    return found


def _predicted(predictions: Mapping[str, Any]) -> Iterator[tuple[str, str, str, Any]]:
    """Yield name, unit, step and bounds of each prediction; for a limit its bounds by the kick."""
    for key, (name, unit) in _PARAMETERS.items():
        yield name, unit, "identify", predictions["parameters"][key]
    yield _DEVICE, "s", "delay", predictions["parameters"]["delay"]
    for inserted in predictions["inserted_delay"]:
        yield _inserted_name(inserted), "s", "delay", inserted
    for point in predictions["critical_stiffness"]:
        yield _limit_name(point), "N·m/rad", "sweep", point


def _figures(measured: Ended) -> Iterator[tuple[str, Figure]]:
    """Yield what was measured, by the names of the predictions."""
    identify, delay = (measured.data(s) or {} for s in ("identify", "delay"))
    estimates = [(name, identify.get(key)) for key, (name, _) in _PARAMETERS.items()]
    if delay:
        estimates.append((_DEVICE, delay["parts"]["device"]))
        estimates += [(_inserted_name(each), each["recovered"]) for each in delay["points"]]
    for name, each in estimates:
        if each and each["value"] is not None and math.isfinite(each["value"]):
            yield name, _figure(each["value"], each["stderr"])
    for point in (measured.data("sweep") or {"points": ()})["points"]:
        if point["measured"] is not None:
            figure = _figure(point["measured"], point["uncertainty"], point["kick_rad"])
            yield _limit_name(point), figure


def _figure(value: float, stderr: float | None, kick_rad: float | None = None) -> Figure:
    return {"value": value, "stderr": stderr, "kick_rad": kick_rad}


def _inserted_name(inserted: Mapping[str, Any]) -> str:
    return f"inserted delay of {1e3 * inserted['inserted']:g} ms, as measured"


def _limit_name(point: Mapping[str, Any]) -> str:
    return (
        f"critical stiffness at B {point['virtual_damping']:.3g} N·m·s/rad,"
        f" {point['delay_steps']} periods inserted"
    )


def _verdict(figure: Figure | None, bounds: Mapping[str, Any] | None) -> str:
    if figure is None or figure["value"] is None:
        return MISSING
    if bounds is None:
        return OBSERVED
    room = _ERRORS * (figure["stderr"] or 0.0)
    inside = bounds["low"] - room <= figure["value"] <= bounds["high"] + room
    return HOLDS if inside else FAILS


def _why(point: Mapping[str, Any]) -> str | None:
    """Return why a point has no figure, or what disturbed the figure that it has."""
    found = [point["reason"]] if point["reason"] else []
    if point["measured"] is not None:
        if point.get("disturbed"):
            found.append(f"{point['disturbed']} trials were disturbed, and repeated")
        found += point["trips"]
    return "; ".join(found) or None


def _side(figure: Figure, bounds: Mapping[str, Any]) -> str:
    """Return on which side of its bounds a limit lies."""
    if (figure["value"] or 0.0) > bounds["high"]:
        return "above, the safe side: the servo has more friction than believed"
    return "below: the guard allows too much; use the report's model, or lower guard.margin"
