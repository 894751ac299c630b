"""The acceptance of a real servo: predicts what a commissioning will measure, and judges it.

All predictions follow from CONFIG: their bounds are those of its belief. They are written before
the first motion, and never again in the same folder. An emulated servo that is what CONFIG believes
takes the same steps beside the real one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from haptic_wall.controller.experiments.commission.agreement import expected
from haptic_wall.controller.experiments.commission.plan import DELAY_STEPS, short_sweep
from haptic_wall.controller.experiments.commission.sequence import Ended
from haptic_wall.controller.experiments.holding import (
    sample_age,
    torque_limit_of,
    without_hand,
)
from haptic_wall.controller.experiments.kept import fingerprint, refused
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.experiments.sweep.plan import PlanePoint
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.files import whole
from haptic_wall.controller.system.json_text import RESULT_MARK

FILE = "predictions.json"
HOLDS, FAILS, OBSERVED, MISSING = "holds", "does not hold", "observed", "not measured"
_ERRORS = 2.0
"""Standard errors within which a prediction holds"""
_KICKS = (0.003, 0.006, 0.0125, 0.025, 0.05, 0.1)
"""[rad]"""
_PERIODS = 0.1
"""Uncertainty of an inserted delay that is recovered [periods]"""
_PARAMETERS = {
    "inertia": ("inertia", "kg·m²"),
    "damping": ("viscous friction", "N·m·s/rad"),
    "coulomb": ("Coulomb friction", "N·m"),
    "delay": ("delay of the servo, by its motions", "s"),
    "torque_gain": ("torque gain", ""),
    "backlash": ("backlash", "rad"),
}
_DEVICE = "delay of the servo, by further runs"
_TRUTH = ("inertia", "damping", "coulomb", "delay", "backlash")

Figure = dict[str, float | None]
"""``value``, ``stderr``, and ``kick_rad``: the amplitude for which a limit holds"""


# Before the first motion


def predicted(config: Config) -> dict[str, Any]:
    """Return the predictions as JSON-ready values, for the effective configuration."""
    belief, period = config.belief(), config.period_s
    return {
        **RESULT_MARK,
        "fingerprint": _fingerprint(config),
        "parameters": {name: asdict(getattr(belief, name)) for name in _PARAMETERS},
        "inserted_delay": [
            {
                "inserted": steps * period,
                "low": (steps - _PERIODS) * period,
                "high": (steps + _PERIODS) * period,
            }
            for steps in DELAY_STEPS
            if steps
        ],
        "critical_stiffness": [_critical(config, point) for point in points(config)],
    }


def points(config: Config) -> tuple[PlanePoint, ...]:
    """Return the points of the boundary that are predicted and measured."""
    return short_sweep(without_hand(config))


def _critical(config: Config, point: PlanePoint) -> dict[str, Any]:
    """Return the predicted critical stiffness over the kick; the sample's age may be any."""
    device = Device.of(without_hand(config))
    inserted = point.delay_steps * device.period + device.lag
    damping = point.virtual_damping
    ends = [
        {
            "virtual_damping": damping,
            "delay_s": inserted + age,
            "exact": device.exact(damping, inserted + age),
        }
        for age in (0.0, sample_age(config))
    ]
    kicks = []
    for kick in _KICKS:
        young, old = (expected(config, end, kick, {}) for end in ends)
        kicks.append(
            {
                "kick_rad": kick,
                "value": 0.5 * (young["value"] + old["value"]),
                "low": min(young["low"], old["low"]),
                "high": max(young["high"], old["high"]),
            }
        )
    exact = [end["exact"] for end in ends]
    without = {"low": min(exact), "high": max(exact)}
    return {**asdict(point), "without_friction": without, "kicks": kicks}


def keep(folder: Path, config: Config) -> dict[str, Any]:
    """Write the predictions, or return those that were written before.

    Raises:
        UserError: The folder has predictions of other settings.
        OSError: They cannot be written.
    """
    path = folder / FILE
    if path.exists():
        try:
            held: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            same = held["fingerprint"] == _fingerprint(config)
        except (ValueError, KeyError, TypeError):
            same = False
        if not same:
            raise refused(
                folder,
                f"found a {FILE} of other settings, or an edited one",
                "name another folder: predictions are never replaced",
            )
        return held
    answer = predicted(config)
    with whole(path) as part:
        part.write_text(json.dumps(answer, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    return answer


def _fingerprint(config: Config) -> str:
    return fingerprint({"config": config.model_dump(mode="json")})


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


# Afterwards


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
            bounds = None if kick is None else _at_kick(wanted, kick)
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
    identify, delay, sweep = (measured.data(s) or {} for s in ("identify", "delay", "sweep"))
    estimates = [(name, identify.get(key)) for key, (name, _) in _PARAMETERS.items()]
    if delay:
        estimates.append((_DEVICE, delay["parts"]["device"]))
        estimates += [(_inserted_name(each), each["recovered"]) for each in delay["points"]]
    for name, each in estimates:
        if each and each["value"] is not None and math.isfinite(each["value"]):
            yield name, {"value": each["value"], "stderr": each["stderr"], "kick_rad": None}
    for point in sweep.get("points", ()):
        if point["measured"] is not None:
            value, stderr, kick = (point[key] for key in ("measured", "uncertainty", "kick_rad"))
            yield _limit_name(point), {"value": value, "stderr": stderr, "kick_rad": kick}


def _inserted_name(inserted: Mapping[str, Any]) -> str:
    return f"inserted delay of {1e3 * inserted['inserted']:g} ms, as measured"


def _limit_name(point: Mapping[str, Any]) -> str:
    return (
        f"critical stiffness at B {point['virtual_damping']:.3g} N·m·s/rad,"
        f" {point['delay_steps']} periods inserted"
    )


def _at_kick(prediction: Mapping[str, Any], kick: float) -> dict[str, float]:
    """Return the predicted critical stiffness at a kick [rad], between those written down."""
    written = prediction["kicks"]
    across = np.log([each["kick_rad"] for each in written])
    return {
        name: float(
            np.exp(np.interp(math.log(kick), across, np.log([each[name] for each in written])))
        )
        for name in ("low", "high")
    }


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
