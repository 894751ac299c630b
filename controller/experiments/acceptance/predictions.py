"""Predicts what an acceptance will measure, with bounds, before anything moves.

Everything follows from CONFIG: the bounds are those of its belief. The predictions are written
before the first motion, and never again in the same folder.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from haptic_wall import __version__
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.commission.agreement import boundary
from haptic_wall.controller.experiments.commission.plan import DELAY_STEPS
from haptic_wall.controller.experiments.commission.sweep_points import short_sweep
from haptic_wall.controller.experiments.holding import sample_age
from haptic_wall.controller.experiments.kept_folder import fingerprint, kept_bytes, replaced
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.experiments.sweep.plan import PlanePoint
from haptic_wall.controller.experiments.sweep.sweep import experiment_config
from haptic_wall.controller.settings.config import Config

FILE = "predictions.json"
GRAVITY = 9.81
"""[m/s²]"""
_KICKS = (0.003, 0.006, 0.0125, 0.025, 0.05, 0.1)
"""[rad]"""
_PERIODS = 0.1
"""Uncertainty of an inserted delay that is recovered [periods]"""
_STATIC = 0.03
"""Uncertainty of the ratio of rendered to commanded stiffness"""
_LEVER = 0.02
"""Uncertainty of a weight on a lever that was measured with a ruler"""
_SLOW = 0.05
"""Uncertainty of friction: it is not exactly Coulomb's"""
SPEED = 0.15
"""Speed at which the shaft travels under the weight [rad/s]"""
_PARAMETERS = ("inertia", "damping", "coulomb", "delay", "torque_gain", "backlash")


@dataclass(frozen=True, slots=True)
class Weight:
    """A known weight on a known lever."""

    mass: float
    """[kg]"""
    lever: float
    """Distance of its centre from the shaft's axis [m]"""

    @property
    def torque(self) -> float:
        """Return its torque on a horizontal lever [N·m]."""
        return GRAVITY * self.mass * self.lever


def predicted(config: Config, weight: Weight | None) -> dict[str, Any]:
    """Return the predictions as JSON-ready values.

    Args:
        config: The effective configuration.
        weight: The weight that will hang on the horn; None: none will.
    """
    belief, period = config.belief(), config.period_s
    gain = belief.torque_gain
    return {
        "program": f"haptic-wall {__version__}",
        "fingerprint": _fingerprint(config, weight),
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
        "static_stiffness_ratio": {"value": 1.0, "low": 1.0 - _STATIC, "high": 1.0 + _STATIC},
        "critical_stiffness": [_critical(config, point) for point in points(config)],
        "load": None
        if weight is None
        else {
            **asdict(weight),
            "torque": weight.torque,
            "commanded": {
                "value": weight.torque / gain.value,
                "low": (1.0 - _LEVER) * weight.torque / gain.high,
                "high": (1.0 + _LEVER) * weight.torque / gain.low,
            },
            "friction_bare": {
                "low": (1.0 - _SLOW)
                * (belief.coulomb.low + SPEED * belief.damping.low)
                / gain.high,
                "high": (1.0 + _SLOW)
                * (belief.coulomb.high + SPEED * belief.damping.high)
                / gain.low,
            },
        },
    }


def points(config: Config) -> tuple[PlanePoint, ...]:
    """Return the points of the boundary that are predicted and measured."""
    return short_sweep(experiment_config(config))


def _critical(config: Config, point: PlanePoint) -> dict[str, Any]:
    """Return the predicted critical stiffness over the kick; the sample's age may be any."""
    device = Device.of(experiment_config(config))
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


def keep(folder: Path, config: Config, weight: Weight | None) -> dict[str, Any]:
    """Write the predictions, or return those that were written before.

    Raises:
        UserError: The folder has predictions of other settings.
        OSError: They cannot be written.
    """
    path = folder / FILE
    if path.exists() or path.is_symlink():
        try:
            held: dict[str, Any] = json.loads(kept_bytes(path, "name another folder"))
            same = held["fingerprint"] == _fingerprint(config, weight)
        except (ValueError, KeyError, TypeError):
            same = False
        if not same:
            raise UserError(
                f"found a {FILE} of other settings, or an edited one",
                field="--out",
                given=folder,
                advice="name another folder: predictions are never replaced",
            )
        return held
    answer = predicted(config, weight)
    with replaced(path) as stream:
        stream.write(json.dumps(answer, indent=2, allow_nan=False) + "\n")
    return answer


def _fingerprint(config: Config, weight: Weight | None) -> str:
    asked = {"config": config.model_dump(mode="json")}
    return fingerprint(asked | {"weight": None if weight is None else asdict(weight)})
