"""Compares theory with measurement: the delay by two methods, and the boundary."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from haptic_wall.controller.experiments.estimated import Estimated
from haptic_wall.controller.experiments.holding import without_hand
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory.harmonic import Lossy, kick_limit

_ERRORS = 2.0
"""Standard errors within which two answers agree"""
_TORQUES = frozenset(("excess", "drag", "dead_band"))
"""Effects in the unit of the identified torque"""
_PERCENT = 0.05
"""Smallest uncertainty of the predicted stiffness, as a fraction: friction is not exactly Coulomb's
"""


def delays(
    identify: Mapping[str, Any], delay: Mapping[str, Any], period: float
) -> dict[str, dict[str, Any]]:
    """Compare the device's own delay from the identification with that from further runs.

    Args:
        identify: Result of the identification step.
        delay: Result of the delay step.
        period: Sampling period [s].
    """
    one = Estimated(**identify["delay"])
    other = Estimated(**delay["parts"]["device"])
    error = math.hypot(one.stderr, other.stderr)
    recovered = [point for point in delay["points"] if point["recovered"] is not None]
    return {
        "device": {
            "identify": identify["delay"],
            "delay": delay["parts"]["device"],
            "difference": other.value - one.value,
            "stderr": error,
            "periods": abs(other.value - one.value) / period,
            "agree": abs(other.value - one.value) <= _ERRORS * error,
        },
        "inserted": {
            "points": [
                {
                    "inserted": point["inserted"],
                    "recovered": point["recovered"],
                    "agree": abs(point["recovered"]["value"] - point["inserted"])
                    <= _ERRORS * point["recovered"]["stderr"],
                }
                for point in recovered
            ],
        },
    }


def boundary(
    config: Config, points: Sequence[Mapping[str, Any]], effects: Mapping[str, float] | None = None
) -> list[dict[str, Any]]:
    """Return each measured point with the model's prediction, including friction and kick.

    Args:
        config: Configuration with the model.
        points: Points of a sweep's report.
        effects: Effects that were identified beside the model, by the names of ``Lossy``.
    """
    config = without_hand(config)
    answers = []
    for point in points:
        answer = {
            "virtual_damping": point["virtual_damping"],
            "delay_steps": point["delay_steps"],
            "delay_s": point["delay_s"],
            "kick_rad": point["kick_rad"],
            "measured": point["measured"],
            "stderr": point["uncertainty"],
            "without_friction": point["exact"],
            "expected": None,
            "low": None,
            "high": None,
            "larger_grows": point.get("larger_grows"),
            "agree": None,
            "reason": point["reason"],
        }
        if point["measured"] is not None:
            expected, soft, stiff = _ends(config, point, effects or {})
            low = min(soft, (1.0 - _PERCENT) * expected)
            high = max(stiff, (1.0 + _PERCENT) * expected)
            error = _ERRORS * (point["uncertainty"] or 0.0)
            agree = low - error <= point["measured"] <= high + error
            answer |= {"expected": expected, "low": low, "high": high, "agree": agree}
        answers.append(answer)
    return answers


def _ends(
    config: Config, point: Mapping[str, Any], effects: Mapping[str, float]
) -> tuple[float, float, float]:
    """Return a point's predicted stiffness: of the model, its softest and stiffest corner."""
    belief, device = config.belief(), Device.of(config)
    m, b, c, slack, lag = (
        (each.value, each.low, each.high)
        for each in (
            belief.inertia,
            belief.damping,
            belief.coulomb,
            belief.backlash,
            belief.delay,
        )
    )
    # Backlash and delay help the softest corner in their largest size.
    slack, lag = ((value, high, low) for value, low, high in (slack, lag))
    gain = belief.torque_gain.value
    # The belief's Coulomb friction is that of slow motion, which contains what fades.
    beside = {**_commanded(effects, gain), "excess": 0.0}
    found = []
    for inertia, damping, coulomb, backlash, late in zip(m, b, c, slack, lag, strict=True):
        servo = Lossy(inertia / gain, damping / gain, coulomb / gain, backlash, **beside)
        delay = max(point["delay_s"] + late - belief.delay.value, 0.0)
        loop = point["virtual_damping"], device.period, delay, point["kick_rad"]
        limit = kick_limit(servo, *loop, device.velocity_samples)
        found.append(limit if math.isfinite(limit) else point["exact"])
    return found[0], found[1], found[2]


def _commanded(effects: Mapping[str, float], gain: float) -> dict[str, float]:
    """Return the effects in commanded torque."""
    return {name: size / gain if name in _TORQUES else size for name, size in effects.items()}
