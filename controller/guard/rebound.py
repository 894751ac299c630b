"""Between which speeds a one-sided wall is guaranteed to return no device faster than it came."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from haptic_wall.controller.guard.types import Situation
from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.theory.rebound import (
    OneSidedWall,
    Servos,
    highest_speed,
    lowest_speed,
    never_faster,
)


@dataclass(frozen=True, slots=True)
class Rebound:
    """The speeds of entry for which the promise of the one-sided limit holds."""

    lowest: float | None
    """Below it encoder counts may throw the device back faster [rad/s]; None: at no speed, or the
    wall is two-sided and promises nothing of the kind"""
    highest: float | None
    """Above it the torque may saturate during the contact [rad/s]; 0: nothing is promised at any
    speed; None: the wall is two-sided"""

    def report(self) -> dict[str, float | None]:
        """Both, by their names in the report."""
        return {"rebound_speed": self.lowest, "rebound_speed_high": self.highest}


NOT_ONE_SIDED = Rebound(None, None)


def rebound(
    stiffness: float,
    damping: float,
    side: Side,
    velocity_samples: int,
    situation: Situation,
    delay: float,
    torque_limit: float | None = None,
) -> Rebound:
    """The speeds for what is commanded, over all servos that the belief admits.

    The low end counts with the least Coulomb friction that is believed in and is found by
    simulating contacts, a tenth of a second to a second of work; the high end is a formula.

    Args:
        stiffness: Commanded K [N·m/rad].
        damping: Commanded B [N·m·s/rad].
        side: Of the wall.
        velocity_samples: N of the velocity difference.
        situation: The belief, the period, the encoder step.
        delay: Total t_d, the device's own lag at its highest included [s].
        torque_limit: What the torque is cut at [N·m]: the smaller of the servo's limit and a clip
            of the wall's own. Default: the situation's.
    """
    if side == "both":
        return NOT_ONE_SIDED
    belief = situation.belief
    limit = situation.torque_limit if torque_limit is None else torque_limit
    wall = OneSidedWall(
        stiffness, damping, situation.period, situation.position_step, limit, velocity_samples
    )
    soonest = max(delay - (belief.delay.high - belief.delay.low), 0.0)
    box = np.array(
        list(
            product(
                {belief.inertia.low, belief.inertia.high},
                {belief.damping.low, belief.damping.high},
                {belief.torque_gain.high, belief.torque_gain.low},
                {delay, soonest},
            )
        )
    )
    if not never_faster(wall, Servos(*box.T)):
        return Rebound(0.0, 0.0)
    least_loss = np.array(
        list(
            product(
                {belief.inertia.low, belief.inertia.high},
                {belief.damping.low},
                {belief.torque_gain.high},
                {delay, soonest},
            )
        )
    )
    return Rebound(
        lowest_speed(wall, Servos(*least_loss.T), belief.coulomb.low),
        highest_speed(wall, Servos(*box.T), belief.coulomb.high),
    )
