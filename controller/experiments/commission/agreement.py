"""Compares theory with measurement: the delay by two methods, the boundary, its straight line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from haptic_wall.controller.experiments.identify.boundary_fit import (
    KnownLoop,
    fit_boundary,
    read_points,
)
from haptic_wall.controller.experiments.identify.identification import Estimated
from haptic_wall.controller.experiments.identify.text import boundary_report, comparison
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.experiments.sweep.sweep import experiment_config
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory import critical_point
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.describing import coulomb_damping

_ERRORS = 2.0
"""Standard errors within which two answers agree"""
_TURNS = 40
"""Iterations of the search for the friction that an oscillation meets"""
_PERCENT = 0.05
"""Smallest uncertainty of the predicted stiffness, as a fraction: friction is not exactly Coulomb's
"""


def delays(
    identify: Mapping[str, Any], delay: Mapping[str, Any], period: float
) -> dict[str, dict[str, Any]]:
    """Compare the device's own delay from the identification with that from torque steps.

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


def boundary(config: Config, points: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return each measured point with the model's prediction, including friction and kick.

    Args:
        config: With the model.
        points: Of a sweep's report.
    """
    measured = [point for point in points if point["measured"] is not None]
    ends = iter(_ends(experiment_config(config), measured)) if measured else iter(())
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
            expected, soft, stiff = next(ends)
            low = min(soft, (1.0 - _PERCENT) * expected)
            high = max(stiff, (1.0 + _PERCENT) * expected)
            error = _ERRORS * (point["uncertainty"] or 0.0)
            agree = low - error <= point["measured"] <= high + error
            answer |= {"expected": expected, "low": low, "high": high, "agree": agree}
        answers.append(answer)
    return answers


def _ends(config: Config, points: Sequence[Mapping[str, Any]]) -> list[list[float]]:
    """Return each point's predicted stiffness: of the model, its softest and stiffest corner."""
    belief, device = config.belief(), Device.of(config)
    gain = belief.torque_gain.value
    corners = (
        (belief.inertia.value, belief.damping.value, belief.coulomb.value, belief.delay.value),
        (belief.inertia.low, belief.damping.low, belief.coulomb.low, belief.delay.high),
        (belief.inertia.high, belief.damping.high, belief.coulomb.high, belief.delay.low),
    )
    m, b, c, lag = (np.array(column)[None, :] for column in zip(*corners, strict=True))
    big_b, delay, kick = (
        np.array([point[name] for point in points])[:, None]
        for name in ("virtual_damping", "delay_s", "kick_rad")
    )
    late = np.maximum(delay + lag - belief.delay.value, 0.0)
    loop = (big_b, device.period, late, device.velocity_samples)
    found = with_friction(m / gain, b / gain, c / gain, loop, kick)
    return [[float(value) for value in row] for row in found]


def with_friction(
    inertia: FloatArray,
    damping: FloatArray,
    coulomb: FloatArray,
    loop: tuple[FloatArray, float, FloatArray, int],
    kick: FloatArray,
) -> FloatArray:
    """Return the stiffness at which motion of an amplitude neither grows nor decays; all broadcast.

    Args:
        inertia: m > 0 [kg·m²].
        damping: b >= 0 [N·m·s/rad].
        coulomb: c >= 0 [N·m].
        loop: Virtual damping B [N·m·s/rad], period T [s], delay t_d [s], velocity samples N.
        kick: Amplitude A > 0 [rad].

    Returns:
        [N·m/rad]

    Source: friction by its describing function, the damping 4 c/(pi A w), in Gil et al., ICRA
    2007, eq. (11).
    """
    rate = np.asarray(kick, dtype=np.float64)
    extra = np.zeros(np.broadcast_shapes(inertia.shape, rate.shape))
    for _ in range(_TURNS):
        at = critical_point(inertia, damping + extra, *loop)
        # More friction damping makes a faster oscillation, which has less of it: the geometric mean
        # converges.
        again = coulomb_damping(kick, np.maximum(np.asarray(at.frequency), 1e-9), coulomb)
        extra = np.where(extra > 0.0, np.sqrt(extra * again), again)
    return np.asarray(critical_point(inertia, damping + extra, *loop).stiffness)


def line(config: Config, identify: Mapping[str, Any], sweep: Path) -> dict[str, Any]:
    """Compare damping and delay from the measured boundary with those from the motion.

    Args:
        config: With the identified model.
        identify: Result of the identification step.
        sweep: The sweep's JSON file.

    Returns:
        ``reason`` alone where there are too few points.
    """
    gain = identify["torque_gain"]["value"]
    # The boundary is measured in commanded torque.
    damping = Estimated(*(identify["damping"][key] / gain for key in ("value", "stderr")))
    loop = KnownLoop(
        inertia=identify["inertia"]["value"] / gain,
        coulomb=identify["coulomb"]["value"] / gain,
        period=config.period_s,
        velocity_samples=config.wall.velocity_samples,
        lag=config.belief().delay.value,
    )
    try:
        fit = fit_boundary(read_points(sweep)[0], loop)
    except ValueError as error:  # too few points, or impossible figures
        return {"reason": str(error)}
    most = 0.5 * fit.damping.value, 0.5 * fit.delay.value + config.period_s
    if fit.damping.stderr > most[0] or fit.delay.stderr > most[1]:
        return {"reason": "the measured points scatter too much about any boundary"}
    motion = damping, Estimated(**identify["delay"])
    return {
        **boundary_report(fit),
        "motion": {"damping": identify["damping"]["value"] / gain, "delay": motion[1].value},
        "compared": comparison(motion, (fit.damping, fit.delay)),
    }
