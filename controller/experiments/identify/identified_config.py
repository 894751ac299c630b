"""Writes a configuration with the identified values as its belief, as commented YAML."""

from __future__ import annotations

import time
from dataclasses import asdict

import numpy as np
import yaml

from haptic_wall.controller.experiments.estimated import Estimated
from haptic_wall.controller.experiments.identify.fit import Friction
from haptic_wall.controller.experiments.identify.identification import Identified
from haptic_wall.controller.experiments.identify.misfit import is_structured
from haptic_wall.controller.experiments.identify.text import residual_text
from haptic_wall.controller.experiments.identify.vibration import (
    believed_vibration,
    vibration_lines,
)
from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.settings.axes import compact
from haptic_wall.controller.settings.config import Config

_ERRORS = 3.0
"""Standard errors between a value and its bounds: those of all values hold the truth together"""
FLOORS = {"inertia": 0.02, "damping": 0.05, "coulomb": 0.05}
"""Least relative distance of a value's bounds: servos warm up and wear between runs"""
_LEAST = 0.05
"""Lower bound of the inertia as a fraction, which the guard needs above zero"""
_BACKLASH_FLOOR = 0.1
"""Least relative distance of the backlash's bounds"""
_SLOW = 0.2
"""Speed of the Coulomb friction's value [rad/s]"""
_HEAVIEST = 0.95
"""Largest inertia of the load, as a fraction of the whole inertia"""
DELAY_FLOOR = 0.05
"""The same for the delay, in periods"""


def identified_config(
    config: Config, identified: Identified, source: str, axis: str = "", whole: Config | None = None
) -> str:
    """Return YAML text of ``config`` with its ``model`` section replaced.

    Args:
        config: The effective configuration.
        identified: Result for its servo.
        source: Origin of ``config``, for people.
        axis: Name of the axis that it is of; empty: it is whole.
        whole: The configuration with all axes, which is written in its place.
    """
    data = (whole or config).model_dump(mode="json")
    own = data["axes"][axis] if axis else data
    own["model"] |= {"current_bandwidth": None} | identified_model(identified, config)
    data = compact(data)
    unit = "torque measured by its current" if identified.gain_measured else "torque commanded"
    floors = ", ".join(f"{100 * share:g} % of {name}" for name, share in FLOORS.items())
    head = [
        f"{source}, with its belief replaced by what haptic-wall identify found on"
        f" {time.strftime('%Y-%m-%d %H:%M')}",
        f"Bounds: {_ERRORS:g} standard errors, at least {floors}, {DELAY_FLOOR:g} periods of the"
        " delay.",
        f"Inertia and friction are in the unit of the {unit}.",
        f"Of the fit: {residual_text(identified)}.",
        *vibration_lines(identified.vibration),
        *identified.warnings,
    ]
    text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, default_flow_style=None)
    return "".join(f"# {line}\n" for line in head) + "\n" + text


def identified_model(identified: Identified, config: Config) -> dict[str, dict[str, float]]:
    """Return value and bounds of each quantity of the model section that was found.

    The bounds are those that both the belief before and the motion allow, where these do not
    contradict each other. Where the residual has structure they are those believed before, in
    their unit: what shifts the motion shifts the values by more than their standard errors.

    Args:
        identified: The result.
        config: Its configuration, for the period and for what was believed before.
    """
    gain = identified.torque_gain.value
    before = config.belief()
    model = {
        name: _bounded(getattr(identified, name), share * getattr(identified, name).value)
        for name, share in FLOORS.items()
    }
    model["inertia"]["low"] = max(model["inertia"]["low"], _LEAST * model["inertia"]["value"])
    if identified.damping_least is not None:
        most = max(model["damping"]["high"], gain / before.torque_gain.low * before.damping.high)
        model["damping"] |= {"low": _short(identified.damping_least), "high": _short(most)}
    model["delay"] = _bounded(identified.delay, DELAY_FLOOR * config.period_s)
    # The other values are in its unit: their bounds contain the uncertainty of the ratio.
    model["torque_gain"] = {"value": gain, "low": gain, "high": gain}
    if identified.backlash is not None and config.velocity_filter() is None:
        backlash = identified.backlash
        model["backlash"] = _bounded(backlash, _BACKLASH_FLOOR * backlash.value)
    plain = not identified.fit.effects
    structured = is_structured(identified.residual, identified.noise, identified.rounding, plain)
    units = _units(model["inertia"], before, gain)
    for name in sorted(model.keys() - {"torque_gain"}, key="coulomb".__eq__):
        if name == "coulomb" and not structured:
            model[name] = _friction(identified.friction, gain, model["damping"])
        far = _ERRORS * getattr(identified, name).stderr
        kept = before.torque_gain.value / gain if structured else None
        model[name] = _narrowed(name, model[name], far, before, units, kept)
    if structured:
        model["torque_gain"] = asdict(before.torque_gain)
    if identified.vibration is not None:
        model |= believed_vibration(identified.vibration, before)
    if "load_inertia" in model:
        # The vibration and the motions may disagree on the whole inertia, of which it is a part.
        load = model["load_inertia"]
        value = min(load["value"], _short(_HEAVIEST * model["inertia"]["value"]))
        model["load_inertia"] = {**load, "value": value, "low": min(load["low"], value)}
    return model


def _friction(found: Friction, gain: float, damping: dict[str, float]) -> dict[str, float]:
    """Return the Coulomb friction beside the damping's bounds, by the sum that was measured.

    Friction that fades with the speed cannot be told from viscous friction, but in slow motion
    their sum is well known. With each end of the damping the Coulomb friction is such that the sum
    is at no speed above, or below, the measured one, so that the bounds hold it jointly.

    Args:
        found: In commanded units.
        gain: Measured over commanded torque.
        damping: Value and bounds of the damping, in measured units.
    """
    sums, errors = gain * found.value, gain * _ERRORS * found.stderr
    rests = {end: sums - at * found.speed for end, at in damping.items()}
    slow = max(float(np.interp(_SLOW, found.speed, rests["value"])), 0.0)
    errors = np.maximum(errors, FLOORS["coulomb"] * rests["value"].clip(0.0))
    low = max(float(np.min(rests["low"] - errors)), 0.0)
    high = float(np.max(rests["high"] + errors))
    slow = max(slow, low)
    return {"value": _short(slow), "low": _short(low), "high": _short(max(high, slow))}


def _units(inertia: dict[str, float], before: Belief, gain: float) -> tuple[float, float]:
    """Return the least and the largest measured per believed torque.

    The motion tells inertia and friction per commanded torque. So the true gain may lie anywhere in
    its bounds, but not where the inertia would be outside of its own.

    Args:
        inertia: Bounds of the motion, in measured units.
        before: The belief.
        gain: Measured over commanded torque.
    """
    least, most = gain / before.torque_gain.high, gain / before.torque_gain.low
    low = max(least, inertia["low"] / before.inertia.high)
    high = min(most, inertia["high"] / before.inertia.low)
    return (low, high) if low <= high else (least, most)


def _narrowed(
    name: str,
    found: dict[str, float],
    far: float,
    before: Belief,
    units: tuple[float, float],
    kept: float | None,
) -> dict[str, float]:
    """Return the bounds that the belief allows too, unless the motion contradicts it.

    Args:
        name: Name of the value.
        found: Value and bounds of the motion.
        far: Distance from the belief's bounds from which the value contradicts them.
        before: The belief.
        units: As ``_units``.
        kept: Believed per measured torque, to keep all that was believed in its unit; None: the
            motion narrows it.
    """
    bounds: Bounded = getattr(before, name)
    torque = name not in ("delay", "backlash")
    least, most = units if torque else (1.0, 1.0)
    low, high = least * bounds.low, most * bounds.high
    if name == "delay" and kept is None and found["value"] > high:
        high = max(high, found["high"])  # the motion tells it well, and a longer one is safer
    promised = bounds.low < bounds.high
    if name == "damping" and not promised and kept is None:
        promised = True
        low, high = (1.0 - FLOORS[name]) * low, (1.0 + FLOORS[name]) * high
    agrees = promised and low - far <= found["value"] <= high + far
    if kept is not None:
        found = {end: kept * each if torque else each for end, each in found.items()}
        ends = [bounds.low, bounds.high, *(() if agrees else (found["low"], found["high"]))]
        low, high = _short(min(ends)), _short(max(ends))
    elif agrees:
        low, high = (_short(min(max(found[end], low), high)) for end in ("low", "high"))
    else:
        return found
    return {"value": min(max(_short(found["value"]), low), high), "low": low, "high": high}


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
