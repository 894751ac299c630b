"""Reading of the encoder, and the ways in which it can be wrong."""

from __future__ import annotations

from haptic_wall.hw.dynamixel.tables import POSITION_UNIT
from haptic_wall.hw.plant.mechanism import Mechanism


class Encoder:
    """The encoder of an emulated servo.

    Args:
        mechanism: Whose shaft it looks at.
        quantised: The mechanism's own encoder has this one's counts; else they are rounded here.
    """

    def __init__(self, mechanism: Mechanism, *, quantised: bool) -> None:
        self._mechanism = mechanism
        self._quantised = quantised
        self._offset = 0
        self._stuck_at: int | None = None

    @property
    def stuck(self) -> bool:
        """It does not follow the shaft."""
        return self._stuck_at is not None

    def counts(self) -> int:
        """Multi-turn counts, at the time the mechanism has come to."""
        if self._stuck_at is not None:
            return self._stuck_at
        if self._quantised:
            return self._mechanism.encoder() + self._offset
        return round(self._mechanism.measured_position() / POSITION_UNIT) + self._offset

    def shift(self, counts: int) -> None:
        """From now on it is off by so many counts more; the shaft is where it was."""
        self._offset += counts

    def stop(self, now_ns: int) -> None:
        """It stays where it is at ``now_ns`` [ns]."""
        self._mechanism.advance(now_ns)
        self._stuck_at = self.counts()

    def free(self) -> None:
        """It follows the shaft again."""
        self._stuck_at = None
