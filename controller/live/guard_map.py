"""The guard's view of a wall: each limit as a curve over the damping, and the decision."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np

from haptic_wall.controller.guard.boundary import EVERY_DAMPING
from haptic_wall.controller.guard.decision_report import decision_report
from haptic_wall.controller.guard.evaluation import Evaluation
from haptic_wall.controller.guard.guard import decide
from haptic_wall.controller.guard.limits import evaluate
from haptic_wall.controller.guard.plants import Plants
from haptic_wall.controller.guard.reasons import explain
from haptic_wall.controller.guard.types import Situation
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.json_text import plain

POINTS: Final = 40
"""Dampings at which the limits are computed"""
LEAST_SPAN: Final = 3.0
"""Largest drawn damping over the requested one, at least [1]"""


def guard_map(config: Config, delay: float) -> dict[str, Any]:
    """Return the limits over the damping, and the decision at a delay.

    Args:
        config: In force.
        delay: The total delay that the guard uses [s].

    Returns:
        ``delay`` [s]; ``damping`` [N·m·s/rad] and ``limits`` by name [N·m/rad], lists of one
        length; and of the report's ``guard``: ``requested``, ``commanded``, ``binding``,
        ``margin``, ``reasons``, ``damping_ceiling``.
    """
    period = config.period_ns * 1e-9
    belief = config.belief()
    known = config.servo.torque_limit
    if known is None and config.servo.kind != "hardware":
        known = config.true_servo().torque_limit
    step = config.servo.position_step if known else 0.0
    before = max(delay - belief.delay.high, 0.0)
    inserted = min(config.delay.steps * period, before)
    situation = Situation(belief, period, known or 1.0, step, inserted=(inserted, inserted))
    request, settings = config.request(step or None), config.guard_settings()
    work = Work()
    (decided,) = decide(request, settings, situation, [before], work)
    decision = explain(decided, settings, situation, work)
    asked = (
        replace(request, damping=0.0),
        EVERY_DAMPING if settings.mode != "passive" else replace(settings, damping_cap=0.999),
        situation,
    )
    corner = Plants.at_corner(situation, np.full(POINTS, before))
    ceiling = Evaluation(*asked, corner, work=work).ceiling
    least = -0.95 * belief.damping.low / belief.torque_gain.high
    most = min(float(ceiling[0]), decision.encoder_damping)
    most = max(most, LEAST_SPAN * request.damping, -LEAST_SPAN * least)
    damping = np.linspace(least, most, POINTS)
    at = Evaluation(*asked, corner, asked=damping, work=work)
    report = decision_report(decision)
    told = ("requested", "commanded", "binding", "margin", "reasons", "damping_ceiling")
    return {
        "delay": delay,
        "damping": damping.tolist(),
        "limits": plain(evaluate(at)),
        **{name: report[name] for name in told},
    }
