"""The acceptance of a real servo: a commissioning beside that of an emulated one, and a judgement.

All predictions follow from CONFIG. The emulated servo is what CONFIG believes: it takes the same
steps first, and its figures are the predicted ones. A figure of the real servo holds if it lies
within the bounds that the belief allows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any

from haptic_wall.controller.experiments.commission.agreement import expected
from haptic_wall.controller.experiments.commission.sequence import Ended
from haptic_wall.controller.experiments.holding import torque_limit_of
from haptic_wall.controller.settings.config import Config

HOLDS, FAILS, MISSING = "holds", "does not hold", "not measured"
_ERRORS = 2.0
"""Standard errors within which a prediction holds"""
_PARAMETERS = {
    "inertia": ("inertia", "kg·m²"),
    "damping": ("viscous friction", "N·m·s/rad"),
    "coulomb": ("Coulomb friction", "N·m"),
    "delay": ("delay of the servo", "s"),
    "torque_gain": ("torque gain", ""),
    "backlash": ("backlash", "rad"),
}
_TRUTH = ("inertia", "damping", "coulomb", "delay", "backlash")


def twin_of(config: Config) -> Config:
    """Return an emulated servo with the middle of the belief as its truth, on the simulated clock.

    The belief, the loop and the driver are CONFIG's. A servo without a bus has a twin without one.

    Args:
        config: The effective configuration.
    """
    belief, gain = config.belief(), config.belief().torque_gain.value
    raw = config.model_dump(mode="json")
    servo = raw["servo"]
    kept = ("backend", "baud", "id", "model", "schedule", "probe_torque", "watchdog_s")
    truth = {name: getattr(belief, name).value for name in _TRUTH}
    for name in ("inertia", "damping", "coulomb"):
        truth[name] /= gain  # a torque gain above 1 moves a servo as if it were lighter
    raw["servo"] = {
        **{name: servo[name] for name in kept if servo.get(name) is not None},
        **truth,
        "torque_limit": torque_limit_of(config),
        "hand": "none",
    }
    if config.servo.kind != "simulated":
        raw["servo"]["port"] = "emulated"
    else:
        raw["servo"]["counts_per_rev"] = config.servo.counts_per_rev
    raw["model"] = {name: asdict(getattr(belief, name)) for name in (*_TRUTH, "torque_gain")}
    raw["loop"]["clock"] = "simulated"
    raw["realtime"] = {"profile": "off"}
    return Config.model_validate(raw)


def rows(config: Config, real: Ended, twin: Ended) -> list[dict[str, Any]]:
    """Return every assumption with its bounds and its measurements.

    Args:
        config: The effective configuration.
        real: The servo of CONFIG.
        twin: The emulated servo.

    Returns:
        For each ``name, unit, step, low, high`` (the bounds), ``real`` and ``emulated`` (each
        ``value, stderr, kick_rad``: the amplitude for which a limit holds; null: not measured),
        ``verdict`` and ``note``.
    """
    here, there = ({row["name"]: row for row in _rows(config, each)} for each in (real, twin))
    found = []
    for name in dict.fromkeys((*there, *here)):
        beside = there.get(name)
        row = here.get(name, {**(beside or {}), "figure": None, "note": None})
        row["real"], row["emulated"] = row.pop("figure"), beside and beside.get("figure")
        if row["real"] is None and (outcome := real.outcomes.get(row["step"])) is not None:
            row["note"] = row["note"] or outcome.reason
        row["verdict"] = _verdict(row)
        if row["verdict"] == FAILS and row["step"] == "sweep":
            above = row["real"]["value"] > row["high"]
            row["note"] = "; ".join(filter(None, (_ABOVE if above else _BELOW, row["note"])))
        elif row["verdict"] == HOLDS and not row["low"] <= row["real"]["value"] <= row["high"]:
            row["note"] = "; ".join(filter(None, (_NEAR, row["note"])))
        found.append(row)
    return found


_NEAR = f"within {_ERRORS:g} standard errors"
_ABOVE = "above, the safe side: the servo has more friction than believed"
_BELOW = "below: the guard allows too much; use the report's model, or lower guard.margin"


def _rows(config: Config, measured: Ended) -> Iterator[dict[str, Any]]:
    """Yield one servo's figures, each with the bounds of the belief."""
    identify, sweep = measured.data("identify") or {}, measured.data("sweep") or {}
    belief = config.belief()

    def row(name: str, unit: str, step: str, bounds: Any, figure: Any) -> dict[str, Any]:  # noqa: ANN401 - JSON
        known = figure and figure["value"] is not None and math.isfinite(figure["value"])
        low, high = (bounds["low"], bounds["high"]) if bounds else (None, None)
        about = {"name": name, "unit": unit, "step": step, "low": low, "high": high}
        return about | {"figure": {"kick_rad": None, **figure} if known else None, "note": None}

    for key, (name, unit) in _PARAMETERS.items():
        bounds, figure = asdict(getattr(belief, key)), identify.get(key)
        if figure:
            yield row(name, unit, "identify", bounds, figure)
    for point in sweep.get("points", ()):
        name = (
            f"critical stiffness at B {point['virtual_damping']:.3g} N·m·s/rad,"
            f" {point['delay_steps']} periods inserted"
        )
        kick, value = point["kick_rad"], point["measured"]
        allowed = None if value is None else expected(config, point, kick, {})
        figure = {"value": value, "stderr": point["uncertainty"], "kick_rad": kick}
        yield row(name, "N·m/rad", "sweep", allowed, figure) | {"note": _why(point)}


def _verdict(row: Mapping[str, Any]) -> str:
    figure = row["real"]
    if figure is None:
        return MISSING
    room = _ERRORS * (figure["stderr"] or 0.0)
    return HOLDS if row["low"] - room <= figure["value"] <= row["high"] + room else FAILS


def _why(point: Mapping[str, Any]) -> str | None:
    """Return why a point has no figure, or what disturbed the figure that it has."""
    found = [point["reason"]] if point["reason"] else []
    if point["measured"] is not None:
        if point["disturbed"]:
            found.append(f"{point['disturbed']} trials were disturbed")
        found += point["trips"]
    return "; ".join(found) or None
