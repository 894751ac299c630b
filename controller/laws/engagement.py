"""Decides when the wall may come on: not while the shaft would load its spring.

A spring of stiffness K that appears around a shaft at penetration p holds K p²/2 at once, and gives
it to the shaft: 0.05 J at K 10 and 0.1 rad, which accelerates a servo with a horn to 2.9 rad/s. The
wall therefore waits, without torque, until its elastic torque K |p| has stayed small for 50 ms. The
same criterion holds for a stiffness that rises while the wall is on: ΔK |p|.
"""

from __future__ import annotations

import math

MOST_TORQUE = 0.1
"""Largest elastic torque at which any wall may come on [N·m]: 1 N at the tip of a 10 cm horn"""
STALL_SHARE = 0.05
"""The same limit as a fraction of the servo's stall torque, for small servos [1]"""
LEAST_STEPS = 2.0
"""Encoder steps within which a spring always counts as unloaded [1]: a reading may be one step off
"""
REST_S = 0.05
"""How long the spring must stay unloaded before the wall comes on [s]"""


def engage_torque(asked: float | None, stall_torque: float) -> float:
    """Return the elastic torque up to which a wall may come on [N·m].

    Args:
        asked: ``safety.engage_torque`` [N·m]; None: derived from the servo.
        stall_torque: Stall torque of the servo [N·m].
    """
    return min(MOST_TORQUE, STALL_SHARE * stall_torque) if asked is None else asked


class Engagement:
    """Decides, tick by tick, whether the wall may come on; O(1).

    Args:
        torque: Largest elastic torque of an unloaded spring [N·m].
        position_step: Encoder step [rad]; 0: the position is not quantised.
        periods: Ticks for which the spring must stay unloaded, >= 1.
        start_room: Penetration up to which the wall may come on at the start even if its spring is
            loaded [rad]; infinite: it comes on at once, at any position of the shaft.
    """

    def __init__(
        self, torque: float, position_step: float, periods: int, *, start_room: float = 0.0
    ) -> None:
        self._torque = torque
        self._least = LEAST_STEPS * position_step
        self._periods = periods
        self._need = 0 if math.isinf(start_room) else periods
        self._start_room = start_room
        self._rested = 0

    @property
    def ready(self) -> bool:
        """Whether the wall may come on now."""
        return self._rested >= self._need

    def room(self, stiffness: float) -> float:
        """Return the largest penetration [rad] at which a spring [N·m/rad] counts as unloaded."""
        return self.most_torque(stiffness) / stiffness if stiffness > 0.0 else math.inf

    def most_torque(self, stiffness: float) -> float:
        """Return the elastic torque [N·m] up to which a spring [N·m/rad] counts as unloaded."""
        return max(self._torque, stiffness * self._least)

    def sample(self, stiffness: float, penetration: float) -> None:
        """Record the shaft's position in a tick with the wall off.

        Args:
            stiffness: Stiffness that would come on [N·m/rad].
            penetration: Penetration of the shaft [rad], signed; 0 outside a one-sided wall.
        """
        if self.may_rise(stiffness, penetration) or abs(penetration) <= self._start_room:
            self._rested += 1
        else:
            self._rested = 0

    def may_rise(self, rise: float, penetration: float) -> bool:
        """Whether the stiffness may rise at once without loading the spring much.

        Args:
            rise: Increase of the stiffness [N·m/rad].
            penetration: Signed penetration of the shaft [rad]; 0 outside a one-sided wall. If it is
                NaN, the stiffness may not rise.
        """
        away = abs(penetration)
        # Without a division: this runs in every tick.
        return rise * away <= self._torque or away <= self._least

    def restart(self) -> None:
        """Record that the wall went off; it comes on again after a time with an unloaded spring."""
        self._start_room = 0.0
        self._need = self._periods
        self._rested = 0


def place_text(position: float) -> str:
    """Format a position [rad] in degrees and turns."""
    degrees, turns = round(math.degrees(position), 1), round(position / math.tau, 2)
    return f"{degrees + 0.0:.1f}° ({turns + 0.0:.2f} turns)"  # + 0.0: never -0.0
