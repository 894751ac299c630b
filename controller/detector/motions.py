"""Watches how the shaft moves in a wall: its half-cycles and its contacts.

A two-sided wall, and a one-sided one under a steady push, is watched by its half-cycles; bouncing
off a one-sided wall by its contacts.
"""

from __future__ import annotations

from typing import Final

from haptic_wall.controller.detector.contacts import Contacts
from haptic_wall.controller.detector.half_cycles import HalfCycles
from haptic_wall.controller.detector.regularity import Regularity
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.tuning import TUNING

CHANGED: Final = 1
"""Older motion no longer counts."""
ENDED: Final = 2
"""A half-cycle inside of the wall has ended."""
BOUNCED: Final = 4
"""A contact with a one-sided wall has ended."""
THROWN: Final = 8
"""One more contact has thrown the shaft back, after enough others."""


class Motions:
    """The motions of a shaft in one wall.

    Attributes:
        half_cycles: The motion between turning points.
        swings: Its regularity, inside of the wall.
        bounces: The regularity of the contacts.
    """

    _inside: bool
    _thrown: int
    _contacts: Contacts

    def __init__(self, settings: WatchSettings) -> None:
        """Start without a motion."""
        self.half_cycles = HalfCycles(settings.period, settings.position_step)
        self.swings = Regularity(self.half_cycles, settings)
        self._at(settings)

    def update(self, away: float, torque: float, span: float) -> int:
        """Take a sample; return the news, a sum of the constants above.

        Args:
            away: Position, counted from that of the wall [rad].
            torque: Sent with the last sample [N·m].
            span: Time since the last sample [s].
        """
        ended = self.half_cycles.update(away, torque, span)
        news = ENDED if ended else 0
        if self._side:
            depth = away * self._side
            inside = depth > 0.0
            if (self._inside or ended) and not (self._inside and inside):
                self.swings.forget()  # a half-cycle with a part outside is no evidence
                news = CHANGED
            self._inside = inside and (self._inside or ended)
            if self._contacts.update(depth, torque * self._side, span):
                news |= BOUNCED
            if self._contacts.gaining != self._thrown:
                self._thrown = self._contacts.gaining
                news |= THROWN if self._thrown >= self._throws else 0
        return news

    def forget(self) -> None:
        """Discard the motion so far."""
        self.half_cycles.forget()
        self.swings.forget()
        self._contacts.forget()
        self.bounces.forget()

    def forget_throws(self) -> None:
        """Count the contacts that throw the shaft back from 0 on."""
        self._contacts.gaining = self._thrown = 0

    def change(self, settings: WatchSettings, moved_by: float) -> None:
        """Go on with the motion at another law.

        Args:
            settings: Settings of the law.
            moved_by: Way from the position of the law before [rad].
        """
        self.half_cycles.shift(moved_by)
        self._contacts.shift(moved_by * settings.side)
        if settings.side != self._side:
            self._at(settings)

    def _at(self, settings: WatchSettings) -> None:
        """Start to watch a wall that fills other positions."""
        self._side, self._throws = settings.side, TUNING.throws
        self._inside, self._thrown = True, 0
        self._contacts = Contacts(settings.position_step)
        self.bounces = Regularity(self._contacts, settings)
