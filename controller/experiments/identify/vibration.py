"""Converts a servo's vibration to the unit of the other results, and to bounds for the guard."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from haptic_wall.controller.experiments.identify.mode import Mode
from haptic_wall.controller.guard.belief import Belief, Bounded

LIGHT_LOAD, HEAVY_LOAD = 0.03, 3.0
"""Least and largest load over motor inertia that are thought possible"""
USUAL_LOAD = 1.0
"""Largest, where no heavier one was believed"""
_UNSEEN_RATIO = Bounded(0.02, 0.005, 0.1)
"""Assumed damping ratio of a vibration that was not seen: bare metal to plastic gears"""
_LEAST_RATIO = 1e-4


@dataclass(frozen=True, slots=True)
class Vibration:
    """The vibration of a load behind the gear's compliance, or its absence."""

    hertz: Bounded
    """With both ends free [Hz]; not seen: below the lower bound there is none"""
    ratio: Bounded | None
    """Damping ratio of the transmission alone; None: not seen"""
    load_inertia: Bounded
    """[kg·m²]; not seen: of a load that may be there"""
    inertia: float
    """Inertia of motor and load [kg·m²]"""


def heaviest_load(inertia: float, belief: Belief) -> float:
    """Return the largest ratio of load to motor inertia that is plausible.

    Args:
        inertia: Inertia of motor and load, in commanded units [kg·m²].
        belief: The belief before the measurement, perhaps of the servo without its load.
    """
    beyond = inertia * belief.torque_gain.high / belief.inertia.low - 1.0
    return min(max(beyond, USUAL_LOAD), HEAVY_LOAD)


def vibration_of(
    mode: Mode, damping: float, scale: float, heaviest: float, rate_hz: float
) -> Vibration:
    """Return the vibration that a mode is.

    Args:
        mode: Mode in commanded units.
        damping: Viscous friction, at most, in commanded units [N·m·s/rad].
        scale: Measured torque per commanded torque.
        heaviest: Largest possible load over motor inertia.
        rate_hz: Rate of the loop [Hz].
    """
    inertia = scale * mode.inertia
    loads = Bounded(math.sqrt(LIGHT_LOAD * heaviest), LIGHT_LOAD, heaviest)
    behind = Bounded(*(inertia * r / (1.0 + r) for r in (loads.value, loads.low, loads.high)))
    if mode.ratio is None:
        low, high = mode.hertz.low, 0.5 * rate_hz
        hertz = Bounded(math.sqrt(low * high), low, high)
        return Vibration(hertz, None, behind, inertia)
    # Friction on the motor damps the vibration too, and is counted by itself.
    per_load = max(damping, 0.0) / (2.0 * math.tau * mode.hertz.value * mode.inertia)
    low = max(mode.ratio.low - per_load * loads.high, _LEAST_RATIO)
    value = max(mode.ratio.value - per_load * loads.value, low)
    return Vibration(
        mode.hertz,
        Bounded(value, low, max(mode.ratio.high, value)),
        behind,
        inertia,
    )


def believed_vibration(found: Vibration, belief: Belief) -> dict[str, dict[str, float]]:
    """Return the fields of the model section that a vibration, or its absence, changes.

    Args:
        found: The result.
        belief: The belief before the measurement.
    """
    if found.ratio is not None:
        return {
            "load_inertia": _entry(found.load_inertia),
            "flexible_hz": _entry(found.hertz),
            "flexible_damping_ratio": _entry(found.ratio),
        }
    low = found.hertz.low
    if belief.is_flexible:
        before = belief.flexible_hz
        if before.low >= low:
            return {}
        high = max(before.high, found.hertz.high)
        value = min(max(before.value, low), high)
        return {"flexible_hz": _entry(Bounded(value, low, high))}
    return {
        "load_inertia": _entry(found.load_inertia),
        "flexible_hz": _entry(found.hertz),
        "flexible_damping_ratio": _entry(_UNSEEN_RATIO),
    }


def vibration_report(found: Vibration | None) -> dict[str, Any] | None:
    """Return a vibration for the report; None: it was not looked for."""
    if found is None:
        return None
    seen = found.ratio is not None
    return {
        "seen": seen,
        "not_seen_below_hz": None if seen else found.hertz.low,
        "flexible_hz": _entry(found.hertz) if seen else None,
        "flexible_damping_ratio": None if found.ratio is None else _entry(found.ratio),
        "load_inertia": _entry(found.load_inertia) if seen else None,
    }


def vibration_lines(found: Vibration | None) -> Iterator[str]:
    """Yield sentences for people, without their full stop."""
    if found is None:
        yield (
            "no search for a vibration: the motions are too small (give a larger --reach), or the"
            " encoder is on the motor"
        )
    elif found.ratio is None:
        yield f"no vibration of a load found below {found.hertz.low:.3g} Hz"
    else:
        hertz, ratio, load = found.hertz, found.ratio, found.load_inertia
        yield (
            f"a load vibrates at {hertz.value:.4g} Hz ({hertz.low:.4g} to {hertz.high:.4g}),"
            f" damping ratio {100 * ratio.value:.2g} % ({100 * ratio.low:.2g} to"
            f" {100 * ratio.high:.2g})"
        )
        yield (
            f"that load has {load.low:.2g} to {load.high:.2g} kg·m², as believed: the motion does"
            " not determine it"
        )


def _entry(bounded: Bounded) -> dict[str, float]:
    value, low, high = (float(f"{each:.6g}") for each in (bounded.value, bounded.low, bounded.high))
    return {"value": value, "low": min(low, value), "high": max(high, value)}
