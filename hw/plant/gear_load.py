"""Computes the friction that a gear adds under load: motor torque u and external torque e.

The friction in motion and what is added to it at rest are ::

    L = |l_m u - l_e e|
    R = |r_m u - r_e e| + Q
    Q = q_e e²  where u and e oppose each other and |e| < |u|: the motor drives
        q_m u²  where they do and |e| > |u|: the external torque drives
        0       else

Source: models M3 (l_m = l_e), M4 (r_m = r_e), M5 (each side its own) and M6 (Q) of Duclusaud et
al., "Extended Friction Models for the Physics Simulation of Servo Actuators" (2024),
arXiv:2410.08650.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple


class GearLoad(NamedTuple):
    """Shares of the loads that a gear adds to the friction."""

    motor: float
    """l_m"""
    external: float
    """l_e"""
    rest_motor: float
    """r_m"""
    rest_external: float
    """r_e"""
    square_motor: float
    """q_m [1/(N·m)]"""
    square_external: float
    """q_e [1/(N·m)]"""

    @property
    def fades(self) -> bool:
        """Whether some of it is there at rest only."""
        return any(self[2:])

    def in_motion(self, motor: float, external: float) -> float:
        """Return L for the torques of both sides [N·m]."""
        return abs(self.motor * motor - self.external * external)

    def at_rest(self, motor: float, external: float) -> float:
        """Return R for the torques of both sides [N·m]."""
        found = abs(self.rest_motor * motor - self.rest_external * external)
        if motor * external < 0.0:
            own, other = abs(motor), abs(external)
            if other < own:
                found += self.square_external * external * external
            elif other > own:
                found += self.square_motor * motor * motor
        return found

    def slope(self, motor: float, external: float) -> float:
        """Return how L + R grows with the external torque; where that jumps, a value beside."""
        found = 0.0
        for own, other in ((self.motor, self.external), (self.rest_motor, self.rest_external)):
            found -= other * math.copysign(1.0, own * motor - other * external)
        if motor * external < 0.0 and abs(external) < abs(motor):
            found += 2.0 * self.square_external * external
        return found

    def until_breakaway(
        self,
        push: float,
        static: float,
        motor: float,
        external: float,
        direction: float,
        most: float,
    ) -> float:
        """Return by how much the external torque must grow until a stuck body breaks away [N·m].

        Args:
            push: Torque on the body [N·m].
            static: Largest friction without load [N·m].
            motor: Motor's torque [N·m].
            external: External torque [N·m].
            direction: +1 or -1: it grows in this direction, and ``push`` with it.
            most: By so much it grows at most [N·m].

        Returns:
            Infinite if that is not enough.
        """
        edges = [0.0, motor, -motor] if self.square_motor or self.square_external else []
        for own, other in ((self.motor, self.external), (self.rest_motor, self.rest_external)):
            if other > 0.0:
                edges.append(own * motor / other)
        grown = (direction * (edge - external) for edge in edges)
        cuts = sorted({0.0, most, *(cut for cut in grown if 0.0 < cut < most)})
        for begin, end in itertools.pairwise(cuts):
            # Between two cuts the torque that is missing is a parabola: three points give it.
            width = end - begin
            low, middle, high = (
                direction * push
                + begin
                + share * width
                - static
                - self.in_motion(motor, external + direction * (begin + share * width))
                - self.at_rest(motor, external + direction * (begin + share * width))
                for share in (0.25, 0.5, 0.75)
            )
            found = _first_above(low, middle, high)
            if found is not None and found <= 1.0:
                return begin + found * width
        return math.inf


def _first_above(low: float, middle: float, high: float) -> float | None:
    """Return where from 0 up a parabola is first at or above 0, by its values at 1/4, 1/2, 3/4."""
    bend = 8.0 * (low - 2.0 * middle + high)
    start = 3.0 * (low - middle) + high
    rise = 2.0 * (high - low) - bend
    if start >= 0.0:
        return 0.0
    if abs(bend) < 1e-12 * (abs(rise) + abs(start)):
        return -start / rise if rise > 0.0 else None
    root = rise * rise - 4.0 * bend * start
    if root < 0.0 or (rise <= 0.0 and bend <= 0.0):
        return None
    return -2.0 * start / (rise + math.sqrt(root))
