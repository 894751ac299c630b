"""How long a servo heard nothing, and what is done where its Bus Watchdog may have tripped."""

from __future__ import annotations

from typing import Final

from haptic_wall.hw.clock import Clock, Suspension
from haptic_wall.hw.dynamixel.link import Link
from haptic_wall.hw.dynamixel.settings import DynamixelSettings
from haptic_wall.hw.dynamixel.tables import WATCHDOG_UNIT_NS
from haptic_wall.hw.dynamixel.watchdog import Armed, lost, rearm, watchdog_units
from haptic_wall.hw.errors import ServoLostError

_NEVER_NS: Final = 1 << 62


class Vigil:
    """Looks after the Bus Watchdog of one servo whenever it was not heard for most of its time.

    Args:
        settings: How the Bus Watchdog is set.
        link: The servo.
        clock: Tells the time.
        name: Of the servo, for messages.

    Raises:
        UnfitServoError: No servo has such a Bus Watchdog.
    """

    __slots__ = (
        "_clock",
        "_link",
        "_name",
        "_suspension",
        "_units",
        "_watchdog_s",
        "called_ns",
        "heard_ns",
        "most_ns",
    )

    def __init__(self, settings: DynamixelSettings, link: Link, clock: Clock, name: str) -> None:
        self._units = watchdog_units(settings)
        self._watchdog_s = settings.watchdog_s
        self._link = link
        self._clock = clock
        self._name = name
        self._suspension = Suspension(clock)
        self.heard_ns = 0
        """When the last request that was answered was sent [ns]"""
        self.called_ns = 0
        """When the servo was last asked for, where a reply takes several periods [ns]"""
        self.most_ns = _NEVER_NS
        """After so long unheard the Bus Watchdog may have tripped; never before ``begin``"""

    def begin(self) -> None:
        """Torque is on from now."""
        self.called_ns = self._clock.now_ns()
        self._suspension = Suspension(self._clock)
        # The watchdog counts whole units, so that one of two may trip soon after the first.
        self.most_ns = round(max(self._units - 1, 0.75) * WATCHDOG_UNIT_NS)

    def end(self) -> None:
        """Torque is off from now; the servo may be left alone for ever."""
        self.most_ns = _NEVER_NS

    def resume(self, now_ns: int, *, under_torque: bool) -> None:
        """See to the Bus Watchdog if the servo was not heard for long; see ``look``."""
        silence_ns = now_ns - self.heard_ns
        if silence_ns > self.most_ns + self._link.patience_ns:
            self.look(silence_ns, under_torque=under_torque)
            self.heard_ns = now_ns

    def call(self, now_ns: int, *, under_torque: bool) -> None:
        """See to the Bus Watchdog after a stall; see ``look``.

        What was heard last says little about one where each reply takes that long.
        """
        pause_ns = now_ns - self.called_ns
        self.called_ns = now_ns
        if pause_ns > self.most_ns:
            self.look(pause_ns, under_torque=under_torque)
            self.heard_ns = self.called_ns = self._clock.now_ns()

    def look(self, silence_ns: int, *, under_torque: bool) -> None:
        """See whether the servo still takes goals after a pause; make it so if nothing was lost.

        Args:
            silence_ns: How long it heard nothing [ns]; 0: it was talked to.
            under_torque: The last goal was not zero.

        Raises:
            ServoLostError: The port is gone, or nothing answers.
            TorqueLostError: The torque is gone.
        """
        armed = rearm(self._link, self._clock, self._units, under_torque=under_torque)
        if armed is not Armed.YES:
            raise self.explained(lost(armed, self._name, silence_ns, self._watchdog_s))

    def explained(self, error: ServoLostError) -> ServoLostError:
        """The same error, or the true cause where the computer was suspended since ``begin``.

        The servo's clock and its registers then look as if its supply had broken down, and the
        silence on this computer's clock is short.

        Args:
            error: What it looks like.
        """
        seconds = self._suspension.seconds()
        if not seconds:
            return error
        return type(error)(
            f"The computer was suspended for {seconds:.3g} s while the {self._name} had torque, so "
            "its Bus Watchdog has dropped it: keep the computer awake, then start again."
        )
