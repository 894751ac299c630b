"""Writes a configuration with the identified values as its belief, as commented YAML."""

from __future__ import annotations

import time

import yaml

from haptic_wall.controller.experiments.estimated import Estimated
from haptic_wall.controller.experiments.identify.identification import Identified
from haptic_wall.controller.experiments.identify.misfit import STRUCTURED
from haptic_wall.controller.experiments.identify.vibration import (
    believed_vibration,
    vibration_lines,
)
from haptic_wall.controller.settings.config import Config

_ERRORS = 3.0
"""Standard errors between a value and its bounds: those of all values hold the truth together"""
FLOORS = {"inertia": 0.02, "damping": 0.05, "coulomb": 0.05}
"""Least relative distance of a value's bounds: servos warm up and wear between runs"""
_LEAST = 0.05
"""Lower bound of the inertia as a fraction, which the guard needs above zero"""
_BACKLASH_FLOOR = 0.1
"""Least relative distance of the backlash's bounds"""
_HEAVIEST = 0.95
"""Largest inertia of the load, as a fraction of the whole inertia"""
DELAY_FLOOR = 0.05
"""The same for the delay, in periods"""


def identified_config(config: Config, identified: Identified, source: str) -> str:
    """Return YAML text of ``config`` with its ``model`` section replaced.

    Args:
        config: The effective configuration.
        identified: Result for its servo.
        source: Origin of ``config``, for people.
    """
    data = config.model_dump(mode="json", exclude_none=True)
    data["model"] = {**data.get("model", {}), **identified_model(identified, config)}
    unit = "torque measured by its current" if identified.gain_measured else "torque commanded"
    floors = ", ".join(f"{100 * share:g} % of {name}" for name, share in FLOORS.items())
    head = [
        f"{source}, with its belief replaced by what haptic-wall identify found on"
        f" {time.strftime('%Y-%m-%d %H:%M')}",
        f"Bounds: {_ERRORS:g} standard errors, at least {floors}, {DELAY_FLOOR:g} periods of the"
        " delay.",
        f"Inertia and friction are in the unit of the {unit}.",
        f"Residual of the fit: {1e3 * identified.residual:.3g} mrad, of which rounding leaves"
        f" {1e3 * identified.rounding:.3g}.",
        *vibration_lines(identified.vibration),
        *identified.warnings,
    ]
    text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, default_flow_style=None)
    return "".join(f"# {line}\n" for line in head) + "\n" + text


def identified_model(identified: Identified, config: Config) -> dict[str, dict[str, float]]:
    """Return value and bounds of each quantity of the model section that was found.

    Where the residual has structure, the bounds contain those that were believed before: what
    shifts the motion shifts the values by more than their standard errors.

    Args:
        identified: The result.
        config: Its configuration, for the period and for what was believed before.
    """
    gain = identified.torque_gain.value
    model = {
        name: _bounded(getattr(identified, name), share * getattr(identified, name).value)
        for name, share in FLOORS.items()
    }
    model["inertia"]["low"] = max(model["inertia"]["low"], _LEAST * model["inertia"]["value"])
    before = config.belief()
    scale = gain / before.torque_gain.value
    believed = scale * before.damping.low, scale * before.damping.high
    if identified.damping_least is not None:
        most = max(model["damping"]["high"], believed[1])
        model["damping"] |= {"low": _short(identified.damping_least), "high": _short(most)}
    unsure = identified.damping_least is not None or identified.fit.effects.excess > 0.0
    model["damping"] = _at_least(
        _not_wider(model["damping"], *believed, unsure=unsure), FLOORS["damping"]
    )
    model["delay"] = _bounded(identified.delay, DELAY_FLOOR * config.period_s)
    # The other values are in its unit: their bounds contain the uncertainty of the ratio.
    model["torque_gain"] = {"value": gain, "low": gain, "high": gain}
    if identified.backlash is not None and config.velocity_filter() is None:
        backlash = identified.backlash
        model["backlash"] = _bounded(backlash, _BACKLASH_FLOOR * backlash.value)
    if identified.residual > STRUCTURED * identified.rounding:
        for name in model.keys() - {"torque_gain"}:
            unit = 1.0 if name in ("delay", "backlash") else scale
            bounds = getattr(before, name)
            model[name] = _containing(model[name], unit * bounds.low, unit * bounds.high)
    if identified.vibration is not None:
        model |= believed_vibration(identified.vibration, before)
    if "load_inertia" in model:
        # The vibration and the motions may disagree on the whole inertia, of which it is a part.
        load = model["load_inertia"]
        value = min(load["value"], _short(_HEAVIEST * model["inertia"]["value"]))
        model["load_inertia"] = {**load, "value": value, "low": min(load["low"], value)}
    return model


def _not_wider(
    found: dict[str, float], low: float, high: float, *, unsure: bool
) -> dict[str, float]:
    """Return the bounds within those believed before, where the motion tells less than these.

    Args:
        found: Value and bounds of the motion.
        low: Bound that was believed.
        high: Bound that was believed.
        unsure: Friction that fades with the speed hides the damping.
    """
    apart = found["high"] <= low or found["low"] >= high
    if apart or not (unsure or found["high"] - found["low"] > high - low):
        return found
    low, high = _short(max(low, found["low"])), _short(min(high, found["high"]))
    return {"value": min(max(found["value"], low), high), "low": low, "high": high}


def _containing(found: dict[str, float], low: float, high: float) -> dict[str, float]:
    """Return the bounds, wider where they do not contain these."""
    low, high = min(found["low"], _short(low)), max(found["high"], _short(high))
    return {**found, "low": low, "high": high}


def _at_least(found: dict[str, float], share: float) -> dict[str, float]:
    """Return the bounds, wider where they are closer together than a relative distance allows."""
    value = found["value"]
    if found["high"] - found["low"] >= 2.0 * share * value:
        return found
    return {"value": value, "low": _short((1 - share) * value), "high": _short((1 + share) * value)}


def _bounded(estimated: Estimated, floor: float) -> dict[str, float]:
    value = max(estimated.value, 0.0)
    away = max(_ERRORS * estimated.stderr, floor)
    return {
        "value": _short(value),
        "low": _short(max(value - away, 0.0)),
        "high": _short(value + away),
    }


def _short(value: float) -> float:
    return float(f"{value:.6g}")
