"""Time-domain passivity control: damping put in where the wall gives more energy than it took.

The wall's balance is what it took from the motion, by the torque that really acted, less what its
spring holds. A spring without delay takes and gives back: the balance stays. Sampling and delay
make the wall give more than it took, and the balance falls below zero; then as much damping is
put in as takes the deficit back. Energy taken earlier is not saved up: it would hide an hour of
oscillation.

Source: Hannaford and Ryu, "Time-domain passivity control of haptic interfaces", IEEE T-RA 18(1),
2002: the series arrangement, with the spring's energy set apart and no credit.
"""

from __future__ import annotations

import math

_SMOOTH = 0.2
"""Share of a new velocity in the smoothed one: over some five samples."""


class PassivityControl:
    """Injected damping, sample by sample; plain floats, O(1).

    Args:
        period: T [s].
        slowest: Below this speed the deficit is taken back as if it moved this fast [rad/s];
            without it a standstill would ask for endless damping.

    Attributes:
        cap: Largest damping injected [N·m·s/rad]: beyond the peak of the boundary more would lower
            the critical stiffness. May be changed at any time.
        injected: Damping to be added to the wall's now [N·m·s/rad].
        balance: Energy the wall took and did not store or give back [J]; never above 0.
    """

    __slots__ = (
        "_last",
        "_last_penetration",
        "_period",
        "_slowest",
        "_speed",
        "balance",
        "cap",
        "injected",
    )

    def __init__(self, period: float, slowest: float) -> None:
        self._period = period
        self._slowest = slowest
        self._speed = 0.0
        self._last = math.nan
        self._last_penetration = 0.0
        self.cap = 0.0
        self.injected = 0.0
        self.balance = 0.0

    def update(
        self, position: float, penetration: float, stiffness: float, torque: float, periods: int
    ) -> float:
        """Take a sample; the damping to be added from now on [N·m·s/rad].

        Args:
            position: [rad]
            penetration: Of the spring, signed; 0 out of contact [rad].
            stiffness: In force [N·m/rad].
            torque: Mean torque that acted since the sample before [N·m].
            periods: From the sample before to this one, >= 1.
        """
        moved = position - self._last
        self._last = position
        before = self._last_penetration
        self._last_penetration = penetration
        if math.isnan(moved):  # the first sample
            return 0.0
        stored = 0.5 * stiffness * (penetration * penetration - before * before)
        balance = self.balance - torque * moved - stored
        self.balance = balance = min(balance, 0.0)
        elapsed = periods * self._period
        self._speed += _SMOOTH * (abs(moved) / elapsed - self._speed)
        speed = max(self._speed, self._slowest)
        self.injected = min(-balance / (elapsed * speed * speed), self.cap)
        return self.injected

    def restart(self) -> None:
        """Forget the balance and the last sample, as after a pause without torque."""
        self._last = math.nan
        self._last_penetration = 0.0
        self._speed = self.balance = self.injected = 0.0
