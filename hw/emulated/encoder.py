"""The encoder of an emulated servo, with its possible faults."""

from __future__ import annotations

from haptic_wall.hw.plant.mechanism import Mechanism


class Encoder:
    """The encoder of an emulated servo.

    Args:
        mechanism: The mechanism whose shaft it measures.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        self._offset = 0
        self._stuck_at: int | None = None

    @property
    def stuck(self) -> bool:
        """Whether it does not follow the shaft."""
        return self._stuck_at is not None

    def counts(self) -> int:
        """Return multi-turn counts, at the mechanism's present time."""
        if self._stuck_at is not None:
            return self._stuck_at
        return self._mechanism.measured()[1] + self._offset

    def shift(self, counts: int) -> None:
        """Add an offset of ``counts`` encoder counts; the shaft does not move."""
        self._offset += counts

    def stop(self, now_ns: int) -> None:
        """Freeze its reading at ``now_ns`` [ns]."""
        self._mechanism.advance(now_ns)
        self._stuck_at = self.counts()

    def free(self) -> None:
        """Follow the shaft again."""
        self._stuck_at = None
