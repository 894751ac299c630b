"""Time-domain passivity control: injects damping where the wall gives more energy than it took.

The wall's balance is the energy that the acting torque took from the motion, less the energy stored
in the spring. An undelayed spring returns all it took, and the balance stays constant. Sampling and
delay make the wall return more; the balance falls below zero, and the control injects enough
damping to recover the deficit. A positive balance is not saved up: it would hide an hour of
oscillation.

Source: Hannaford and Ryu, "Time-domain passivity control of haptic interfaces", IEEE T-RA 18(1),
2002: the series arrangement, without the spring's energy and without credit.
"""

from __future__ import annotations

import math

_SMOOTH = 0.2
"""Weight of a new velocity in the smoothed one: a mean over about five samples."""


class PassivityControl:
    """Computes the injected damping, sample by sample; plain floats, O(1).

    Args:
        period: T [s].
        slowest: Lower limit of the speed in the computation [rad/s]; without it a standstill would
            ask for infinite damping.

    Attributes:
        cap: Largest injected damping [N·m·s/rad]: more, beyond the peak of the boundary, would
            lower the critical stiffness. May be changed at any time.
        injected: Damping to add to the wall's now [N·m·s/rad].
        balance: Energy the wall took and neither stored nor returned [J]; never above 0.
    """

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
        """Take a sample; return the damping to add from now on [N·m·s/rad].

        Args:
            position: [rad]
            penetration: Elongation of the spring; 0 out of contact [rad].
            stiffness: Present stiffness [N·m/rad].
            torque: Mean torque that acted since the last sample [N·m].
            periods: Number of periods from the last sample to this one, >= 1.
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

    def rebase(self, penetration: float) -> None:
        """Count the stored energy from that of another law at the last position.

        The change gave nothing to the shaft, so that the balance stays.

        Args:
            penetration: Elongation of the new law's spring there [rad].
        """
        self._last_penetration = penetration

    def restart(self) -> None:
        """Forget the balance and the last sample, as after a pause without torque."""
        self._last = math.nan
        self._last_penetration = 0.0
        self._speed = self.balance = self.injected = 0.0
