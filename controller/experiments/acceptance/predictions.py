"""Predicts what an acceptance will measure, with bounds, before anything moves.

Everything follows from CONFIG: the bounds are those of its belief. The predictions are written
before the first motion, and never again in the same folder.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from haptic_wall import __version__
from haptic_wall.controller.experiments.commission.agreement import boundary
from haptic_wall.controller.experiments.commission.plan import DELAY_STEPS
from haptic_wall.controller.experiments.commission.sweep_points import short_sweep
from haptic_wall.controller.experiments.holding import sample_age, without_hand
from haptic_wall.controller.experiments.kept import fingerprint, refused
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.experiments.sweep.plan import PlanePoint
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.files import whole

FILE = "predictions.json"
_KICKS = (0.003, 0.006, 0.0125, 0.025, 0.05, 0.1)
"""[rad]"""
_PERIODS = 0.1
"""Uncertainty of an inserted delay that is recovered [periods]"""
_PARAMETERS = ("inertia", "damping", "coulomb", "delay", "torque_gain", "backlash")


def predicted(config: Config) -> dict[str, Any]:
    """Return the predictions as JSON-ready values, for the effective configuration."""
    belief, period = config.belief(), config.period_s
    return {
        "program": f"haptic-wall {__version__}",
        "fingerprint": _fingerprint(config),
        "parameters": {
            name: {"value": each.value, "low": each.low, "high": each.high}
            for name, each in ((name, getattr(belief, name)) for name in _PARAMETERS)
        },
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
    ages = (0.0, sample_age(config))
    exact = [device.exact(point.virtual_damping, inserted + age) for age in ages]
    kicks = []
    for kick in _KICKS:
        found = [
            boundary(
                config,
                [
                    {
                        "virtual_damping": point.virtual_damping,
                        "delay_steps": point.delay_steps,
                        "delay_s": inserted + age,
                        "kick_rad": kick,
                        "measured": limit,
                        "uncertainty": 0.0,
                        "exact": limit,
                        "reason": None,
                    }
                ],
            )[0]
            for age, limit in zip(ages, exact, strict=True)
        ]
        kicks.append(
            {
                "kick_rad": kick,
                "value": 0.5 * (found[0]["expected"] + found[1]["expected"]),
                "low": min(each["low"] for each in found),
                "high": max(each["high"] for each in found),
            }
        )
    return {
        **asdict(point),
        "without_friction": {"low": min(exact), "high": max(exact)},
        "kicks": kicks,
    }


def at_kick(prediction: Mapping[str, Any], kick: float) -> dict[str, float]:
    """Return the predicted critical stiffness at a kick, between those that were written down.

    Args:
        prediction: One of ``critical_stiffness``.
        kick: [rad]
    """
    written: Sequence[Mapping[str, float]] = prediction["kicks"]
    across = [math.log(each["kick_rad"]) for each in written]
    return {
        name: float(
            np.exp(np.interp(math.log(kick), across, [math.log(each[name]) for each in written]))
        )
        for name in ("value", "low", "high")
    }


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
