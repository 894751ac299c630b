"""Compares the measured boundary of stability with the predicted one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from haptic_wall.controller.experiments.holding import without_hand
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory.harmonic import Lossy, kick_limit

_ERRORS = 2.0
"""Standard errors within which two answers agree"""
_KEYS = {
    **{key: key for key in ("virtual_damping", "delay_steps", "delay_s", "kick_rad", "measured")},
    **{"stderr": "uncertainty", "without_friction": "exact"},
    "reason": "reason",
}
"""Keys of a compared point, with the keys of the sweep's point that they repeat"""
_PERCENT = 0.05
"""Smallest uncertainty of the predicted stiffness, as a fraction: friction is not exactly Coulomb's
"""


def boundary(
    config: Config, points: Sequence[Mapping[str, Any]], effects: Mapping[str, float] | None = None
) -> list[dict[str, Any]]:
    """Return each measured point with the model's prediction, including friction and kick.

    Args:
        config: Configuration with the model.
        points: Points of a sweep's report.
        effects: Effects that were identified beside the model, by the names of ``Lossy``; what
            fades with the speed is part of the belief's Coulomb friction, that of slow motion.
    """
    answers = []
    for point in points:
        answer = {name: point.get(key) for name, key in _KEYS.items()}
        answer |= {"expected": None, "low": None, "high": None, "agree": None}
        if point["measured"] is not None:
            found = expected(config, point, point["kick_rad"], effects or {})
            room = _ERRORS * (point["uncertainty"] or 0.0)
            agree = found["low"] - room <= point["measured"] <= found["high"] + room
            answer |= {"expected": found.pop("value"), **found, "agree": agree}
        answers.append(answer)
    return answers


def expected(
    config: Config, point: Mapping[str, Any], kick: float, effects: Mapping[str, float]
) -> dict[str, float]:
    """Return a predicted stiffness and its bounds over the belief: ``value, low, high`` [N·m/rad].

    Args:
        config: Configuration with the model.
        point: ``virtual_damping``, total ``delay_s``, and ``exact``: what holds where friction
            sustains no cycle.
        kick: [rad]
        effects: See ``boundary``.
    """
    belief, device = config.belief(), Device.of(without_hand(config))
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
    units = {"gear": 1.0, "drag": gain, "dead_band": gain}
    beside = {name: effects.get(name, 0.0) / unit for name, unit in units.items()}
    found = []
    for inertia, damping, coulomb, backlash, late in zip(m, b, c, slack, lag, strict=True):
        servo = Lossy(inertia / gain, damping / gain, coulomb / gain, backlash, **beside)
        delay = max(point["delay_s"] + late - belief.delay.value, 0.0)
        loop = point["virtual_damping"], device.period, delay, kick
        limit = kick_limit(servo, *loop, device.loop.samples)
        found.append(limit if math.isfinite(limit) else float(point["exact"]))
    value, soft, stiff = found
    low, high = min(soft, (1.0 - _PERCENT) * value), max(stiff, (1.0 + _PERCENT) * value)
    return {"value": value, "low": low, "high": high}
