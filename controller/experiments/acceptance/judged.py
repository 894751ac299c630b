"""Judges each prediction of an acceptance by its measurement; adds the emulated servo's value."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from haptic_wall.controller.experiments.acceptance.predictions import at_kick
from haptic_wall.controller.experiments.commission.sequence import Ended

_ERRORS = 2.0
"""Standard errors within which a prediction holds"""
HOLDS, FAILS, OBSERVED, MISSING = "holds", "does not hold", "observed", "not measured"
_UNITS = {
    "inertia": "kg·m²",
    "damping": "N·m·s/rad",
    "coulomb": "N·m",
    "delay": "s",
    "torque_gain": "",
    "backlash": "rad",
}
_WORDS = {
    "damping": "viscous friction",
    "coulomb": "Coulomb friction",
    "delay": "delay of the servo, by its motions",
    "torque_gain": "torque gain",
}


@dataclass(frozen=True, slots=True)
class Figure:
    """A measured figure."""

    value: float
    stderr: float | None = None
    kick_rad: float | None = None
    """Amplitude for which a limit holds"""


@dataclass(frozen=True, slots=True)
class Row:
    """One assumption."""

    name: str
    unit: str
    step: str
    low: float | None
    """Predicted; None: nothing was predicted"""
    high: float | None
    real: Figure | None
    emulated: Figure | None
    verdict: str
    note: str | None = None

    def report(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return asdict(self)


def rows(predictions: Mapping[str, Any], real: Ended, twin: Ended) -> list[Row]:
    """Return every assumption with its prediction and its measurements.

    Args:
        predictions: As they were written before.
        real: The servo of CONFIG.
        twin: The emulated servo.
    """
    found = [
        *_parameters(predictions, real, twin),
        *_delays(predictions, real, twin),
        *_rendered(predictions, real, twin),
        *_limits(predictions, real, twin),
    ]
    return [row for row in found if row.real is not None or row.emulated is not None or row.note]


def _row(
    name: str,
    unit: str,
    step: str,
    bounds: Mapping[str, float] | None,
    real: Figure | None,
    twin: Figure | None,
    note: str | None = None,
) -> Row:
    low, high = (None, None) if bounds is None else (bounds["low"], bounds["high"])
    if real is None:
        verdict = MISSING
    elif low is None or high is None:
        verdict = OBSERVED  # nothing was predicted at its kick
    else:
        room = _ERRORS * (real.stderr or 0.0)
        verdict = HOLDS if low - room <= real.value <= high + room else FAILS
    return Row(name, unit, step, low, high, real, twin, verdict, note)


def _estimate(found: Mapping[str, Any] | None) -> Figure | None:
    if found is None or found.get("value") is None or not math.isfinite(found["value"]):
        return None
    return Figure(found["value"], found.get("stderr"))


def _parameters(predictions: Mapping[str, Any], *measured: Ended) -> Iterator[Row]:
    for name, unit in _UNITS.items():
        real, twin = (_estimate((each.data("identify") or {}).get(name)) for each in measured)
        words = _WORDS.get(name, name)
        yield _row(words, unit, "identify", predictions["parameters"][name], real, twin)


def _delays(predictions: Mapping[str, Any], *measured: Ended) -> Iterator[Row]:
    data = [each.data("delay") for each in measured]
    real, twin = (_estimate(each["parts"]["device"] if each else None) for each in data)
    bounds = predictions["parameters"]["delay"]
    yield _row("delay of the servo, by further runs", "s", "delay", bounds, real, twin)
    for inserted in predictions["inserted_delay"]:
        found = [
            next(
                (
                    _estimate(point["recovered"])
                    for point in (each["points"] if each else ())
                    if math.isclose(point["inserted"], inserted["inserted"], abs_tol=1e-9)
                ),
                None,
            )
            for each in data
        ]
        name = f"inserted delay of {1e3 * inserted['inserted']:g} ms, as measured"
        yield _row(name, "s", "delay", inserted, found[0], found[1])


def _rendered(predictions: Mapping[str, Any], *measured: Ended) -> Iterator[Row]:
    real, twin = (_static(each.data("rendered")) for each in measured)
    bounds = predictions["static_stiffness_ratio"]
    yield _row("rendered over commanded stiffness", "", "rendered", bounds, real, twin)


def _static(rendered: Mapping[str, Any] | None) -> Figure | None:
    for row in rendered["rows"] if rendered else ():
        if row["name"] == "static stiffness" and row["rendered"] and row["commanded"]:
            return Figure(
                row["rendered"] / row["commanded"], (row["stderr"] or 0.0) / row["commanded"]
            )
    return None


def _limits(predictions: Mapping[str, Any], *measured: Ended) -> Iterator[Row]:
    for wanted in predictions["critical_stiffness"]:
        points = [_point(each.data("sweep"), wanted) for each in measured]
        figures = [
            None
            if point is None or point["measured"] is None
            else Figure(point["measured"], point["uncertainty"], point["kick_rad"])
            for point in points
        ]
        real = figures[0]
        kick = next((each.kick_rad for each in figures if each is not None and each.kick_rad), None)
        bounds = None if kick is None else at_kick(wanted, kick)
        note = _why(points[0], _reason(measured[0]))
        name = (
            f"critical stiffness at B {wanted['virtual_damping']:.3g} N·m·s/rad,"
            f" {wanted['delay_steps']} periods inserted"
        )
        row = _row(name, "N·m/rad", "sweep", bounds, real, figures[1], note)
        said = [_side(row), note] if row.verdict == FAILS else [note]
        yield replace(row, note="; ".join(filter(None, said)) or None)


def _reason(measured: Ended) -> str | None:
    outcome = measured.outcomes.get("sweep")
    return None if outcome is None else outcome.reason


def _why(point: Mapping[str, Any] | None, ended: str | None) -> str | None:
    """Return why a point has no figure, or what disturbed the figure that it has."""
    if point is None:
        return None if ended is None else f"the sweep ended before: {ended}"
    found = [point["reason"]] if point["reason"] else []
    if point["measured"] is not None:
        if point.get("disturbed"):
            found.append(f"{point['disturbed']} trials were disturbed, and repeated")
        found += point["trips"]
    return "; ".join(found) or None


def _side(row: Row) -> str:
    """Return on which side of its bounds a limit lies."""
    if row.real is not None and row.high is not None and row.real.value > row.high:
        return "above, the safe side: the servo has more friction than believed"
    return "below: the guard allows too much; use the report's model, or lower guard.margin"


def _point(sweep: Mapping[str, Any] | None, wanted: Mapping[str, Any]) -> Any:  # noqa: ANN401
    for point in sweep["points"] if sweep else ():
        if (point["virtual_damping"], point["delay_steps"]) == (
            wanted["virtual_damping"],
            wanted["delay_steps"],
        ):
            return point
    return None
