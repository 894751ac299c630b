"""Computes the entry speeds at which a one-sided wall adds no speed to any believed device."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from haptic_wall.controller.guard.decision_report import finite
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
    """The range of entry speeds in which the promise of the one-sided limit holds."""

    lowest: float | None
    """Below this speed encoder counts may return the device faster than it came [rad/s]. None: the
    promise holds at no speed, or the wall is two-sided and promises none."""
    highest: float | None
    """Above this speed the torque may saturate during the contact [rad/s]. 0: the promise holds at
    no speed; infinite without stiffness and damping; None: the wall is two-sided."""

    def report(self) -> dict[str, float | None]:
        """Return both speeds under their names in the report."""
        high = None if self.highest is None else finite(self.highest)
        return {"rebound_speed": self.lowest, "rebound_speed_high": high}


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
    """Compute the speeds for the commanded wall, over all servos that the belief admits.

    The low end uses the least believed Coulomb friction. It is found by simulating contacts, which
    takes 0.1 s to 1 s. The high end is a formula.

    Args:
        stiffness: Commanded K [N·m/rad].
        damping: Commanded B [N·m·s/rad].
        side: Side of the wall.
        velocity_samples: N of the velocity difference.
        situation: The belief, the period, the encoder step.
        delay: Total t_d, the device's own highest lag included [s].
        torque_limit: Torque at which the command saturates [N·m]: the smaller of the servo's limit
            and the wall's own clip. Default: the situation's.
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
