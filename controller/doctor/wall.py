"""Judges whether the servo's Current Limit leaves the requested wall a stiffness."""

from __future__ import annotations

import bisect
from typing import Final

from haptic_wall.controller.guard.guard import Decision, Situation, decide
from haptic_wall.controller.guard.reasons import sentences
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.dynamixel.tables import POSITION_UNIT
from haptic_wall.hw.dynamixel.torque_law import TorqueLaw
from haptic_wall.hw.servo import Check

_NONE: Final = 1e-6
"""Stiffness that is none [N·m/rad]"""


def judge_wall(config: Config, current: int, most: int, law: TorqueLaw) -> Check:
    """Judge the stiffness that the guard would command.

    Args:
        config: The requested wall, and the belief.
        current: Current Limit (38) of the servo.
        most: The model's largest.
        law: Converts it to a torque.
    """
    request = config.request(POSITION_UNIT)
    period = config.period_ns * 1e-9
    inserted = config.delay.steps * period

    def decided(current: int) -> Decision:
        limit = config.servo.torque_limit or 0.0
        torque = law.torque(current)
        torque = min(torque, limit) if limit > 0.0 else torque
        situation = Situation(config.belief(), period, torque, POSITION_UNIT)
        return decide(request, config.guard_settings(), situation, [inserted], inserted)[0]

    decision = decided(current)
    asked, given = request.stiffness, decision.stiffness
    ok = given >= min(asked, _NONE)
    found = f"{given:.4g} of {asked:.4g} N·m/rad at a Current Limit (38) of {current}"
    fix = ""
    if not ok:
        best = decided(most).stiffness
        choices = range(current, most + 1)
        enough = bisect.bisect(choices, False, key=lambda each: decided(each).stiffness >= best)
        fix = (
            f"raise Current Limit (38) to {choices[enough]}, which leaves {best:.4g} N·m/rad"
            if best > _NONE
            else "; ".join(sentences(decision.reasons))
        )
    return Check("stiffness", ok, found, "above 0" if asked else "0", fix)
