"""Whether theory and measurement say the same: the delay twice, the boundary, its straight line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from controller.belief import Bounded
from controller.config import Config
from controller.errors import UserError
from controller.experiments.boundary_fit import Loop, fit_boundary, read_points
from controller.experiments.identification import Estimated
from controller.experiments.identify_text import boundary_report, comparison
from controller.experiments.sweep import experiment_config
from controller.experiments.sweep_device import Device
from controller.experiments.sweep_plan import Setting, reach

_ERRORS = 2.0
"""Standard errors within which two answers are the same"""
_PERCENT = 0.05
"""Of the stiffness that theory is trusted to at best: friction is not quite Coulomb's"""


def delays(
    identify: Mapping[str, Any], delay: Mapping[str, Any], period: float
) -> dict[str, dict[str, Any]]:
    """The device's own delay, from the identification's motions and from torque steps.

    Args:
        identify: What that step found.
        delay: What that one found.
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


def boundary(config: Config, points: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Each measured point beside what the model expects there, friction and kick counted.

    Args:
        config: With the model.
        points: Of a sweep's report.
    """
    config = experiment_config(config)
    device, belief = Device.of(config), config.belief()
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
            "agree": None,
            "reason": point["reason"],
        }
        if point["measured"] is not None:
            gain = belief.torque_gain.value
            soft, stiff = (
                _expected(
                    replace(
                        device,
                        inertia=_end(belief.inertia, way) / gain,
                        damping=_end(belief.damping, way) / gain,
                        coulomb=_end(belief.coulomb, way) / gain,
                    ),
                    point,
                    _end(belief.delay, -way) - belief.delay.value,
                )
                for way in (-1, 1)
            )
            expected = _expected(device, point, 0.0)
            low = min(soft, (1.0 - _PERCENT) * expected)
            high = max(stiff, (1.0 + _PERCENT) * expected)
            error = _ERRORS * (point["uncertainty"] or 0.0)
            agree = low - error <= point["measured"] <= high + error
            answer |= {"expected": expected, "low": low, "high": high, "agree": agree}
        answers.append(answer)
    return answers


def _end(bounded: Bounded, way: int) -> float:
    return bounded.high if way > 0 else bounded.low


def _expected(device: Device, point: Mapping[str, Any], later: float) -> float:
    """Stiffness at which motion of the point's amplitude neither grows nor dies [N·m/rad]."""
    delay = max(point["delay_s"] + later, 0.0)
    setting = Setting(point["virtual_damping"], point["delay_steps"])
    if device.exact(setting.virtual_damping, delay) <= 0.0:
        return 0.0
    return reach(device, setting, delay, point["kick_rad"]).predicted


def line(config: Config, identify: Mapping[str, Any], sweep: Path) -> dict[str, Any]:
    """Damping and delay from the measured boundary, compared with those of the motion.

    Args:
        config: With the identified model.
        identify: What that step found.
        sweep: The sweep's JSON file.

    Returns:
        ``reason`` alone where there are too few points.
    """
    try:
        points, _ = read_points(sweep)
    except UserError as error:
        return {"reason": str(error)}
    gain = identify["torque_gain"]["value"]
    # The boundary is measured in torque commanded.
    damping = Estimated(*(identify["damping"][key] / gain for key in ("value", "stderr")))
    fit = fit_boundary(
        points,
        Loop(
            inertia=identify["inertia"]["value"] / gain,
            coulomb=identify["coulomb"]["value"] / gain,
            period=config.period_s,
            velocity_samples=config.wall.velocity_samples,
            lag=config.belief().delay.value,
        ),
    )
    motion = damping, Estimated(**identify["delay"])
    return {
        **boundary_report(fit),
        "motion": {"damping": identify["damping"]["value"] / gain, "delay": motion[1].value},
        "compared": comparison(motion, (fit.damping, fit.delay)),
    }
