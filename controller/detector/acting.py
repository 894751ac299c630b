"""Computes the torque that acted while the servo moved: the sent torque, delayed by the lag.

Work is acting torque times motion of the same period: combining the motion with the torque just
sent would hide the effect of the delay.
"""

from __future__ import annotations

_SPARE = 64
"""Periods kept beyond the lag, so that skipped periods and a slightly larger lag need no new
memory."""


class ActingTorque:
    """Computes the mean torque over the period that ends with the present sample.

    A torque sent with sample k acts from ``lag`` periods after that sample on, until the next one
    does. With lag = n + f (n whole, 0 <= f < 1) the mean over the period that ends with sample k is
    ``f u[k-n-2] + (1-f) u[k-n-1]``. Before the first torque, zeros were sent.

    It counts periods, not calls: over skipped ones the last torque was held.

    Attributes:
        last: The last torque sent [N·m].
    """

    def __init__(self, lag_periods: float = 0.0) -> None:
        """Start with a delay from a sample until its torque acts, >= 0 [periods]."""
        self._ring: list[float] = []
        self._at = 0  # index of the next torque
        self.last = 0.0
        self.delay_by(lag_periods)

    def delay_by(self, lag_periods: float) -> None:
        """Set the delay from a sample until its torque acts, >= 0 [periods]."""
        self._whole = int(lag_periods)
        self._fraction = lag_periods - self._whole
        if len(self._ring) < self._whole + 3:
            size = self._whole + 3 + _SPARE
            old, at = self._ring, self._at
            self._ring = [0.0] * (size - len(old)) + old[at:] + old[:at]
            self._at = 0

    def acted(self, periods: int = 1) -> float:
        """Return the mean torque from the last sample to the present one [N·m], ``periods`` later.

        Call it once a sample, before ``send``.
        """
        if periods > 1:
            return self._skipped(periods)
        ring, fraction = self._ring, self._fraction
        newer = self._at - 1 - self._whole  # at least -len(ring): lists count from the end too
        if fraction == 0.0:
            return ring[newer]
        return fraction * ring[newer - 1] + (1.0 - fraction) * ring[newer]

    def send(self, torque: float) -> None:
        """Store the torque sent with the present sample [N·m]."""
        ring, at = self._ring, self._at
        ring[at] = self.last = torque
        self._at = (at + 1) % len(ring)

    def _skipped(self, periods: int) -> float:
        # After more periods than the ring's length only the last torque is left.
        turns = min(periods, len(self._ring) + 1)
        total = 0.0
        for turn in range(turns):
            if turn:
                self.send(self.last)
            total += self.acted()
        return (total + (periods - turns) * self.last) / periods
