"""Measures how long a servo was without instructions; examines its Bus Watchdog after a pause."""

from __future__ import annotations

from typing import Final

from haptic_wall.hw.clock import Clock, Suspension
from haptic_wall.hw.dynamixel.link import Link
from haptic_wall.hw.dynamixel.tables import WATCHDOG_UNIT_NS
from haptic_wall.hw.dynamixel.watchdog import Armed, rearm, unarmed, watchdog_units
from haptic_wall.hw.errors import ServoLostError
from haptic_wall.hw.settings import DriverSettings

_NEVER_NS: Final = 1 << 62


class WatchdogMonitor:
    """Examines the Bus Watchdog of one servo after a pause in which it may have tripped.

    Args:
        settings: Contains the time of the Bus Watchdog.
        link: The servo.
        clock: Tells the time.
        name: Name of the servo, for messages.

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

    def __init__(self, settings: DriverSettings, link: Link, clock: Clock, name: str) -> None:
        self._units = watchdog_units(settings)
        self._watchdog_s = settings.watchdog_s
        self._link = link
        self._clock = clock
        self._name = name
        self._suspension = Suspension(clock)
        self.heard_ns = 0
        """When the last answered request was sent [ns]"""
        self.called_ns = 0
        """When the last request was sent, where a reply takes several periods [ns]"""
        self.most_ns = _NEVER_NS
        """Pause after which the Bus Watchdog may have tripped [ns]; not reached before ``begin``"""

    def begin(self) -> None:
        """Start monitoring: the torque is on from now."""
        self.called_ns = self._clock.now_ns()
        self._suspension = Suspension(self._clock)
        # The watchdog counts whole units, so that one set to two may trip soon after the first.
        self.most_ns = round(max(self._units - 1, 0.75) * WATCHDOG_UNIT_NS)

    def end(self) -> None:
        """Stop monitoring: the torque is off from now, and pauses may have any length."""
        self.most_ns = _NEVER_NS

    def resume(self, now_ns: int, *, under_torque: bool) -> None:
        """Examine the Bus Watchdog if the last answered request is too long ago; see ``look``."""
        silence_ns = now_ns - self.heard_ns
        if silence_ns > self.most_ns + self._link.patience_ns:
            self.look(silence_ns, under_torque=under_torque)
            self.heard_ns = now_ns

    def call(self, now_ns: int, *, under_torque: bool) -> None:
        """Examine the Bus Watchdog if the last request was sent long ago; see ``look``.

        For a bus on which each reply takes several periods: there the last answered request does
        not show the length of a pause.
        """
        pause_ns = now_ns - self.called_ns
        self.called_ns = now_ns
        if pause_ns > self.most_ns:
            self.look(pause_ns, under_torque=under_torque)
            self.heard_ns = self.called_ns = self._clock.now_ns()

    def look(self, silence_ns: int, *, under_torque: bool) -> None:
        """Check whether the servo still has torque; then arm its Bus Watchdog again.

        Args:
            silence_ns: Time without an instruction [ns]; 0: there was none.
            under_torque: The last goal was not zero.

        Raises:
            ServoLostError: The port is gone, or there is no reply.
            TorqueLostError: The torque is gone.
        """
        armed = rearm(self._link, self._units, under_torque=under_torque)
        if armed is not Armed.YES:
            raise self.explained(
                unarmed(self._link, armed, self._name, silence_ns, self._watchdog_s)
            )

    def explained(self, error: ServoLostError) -> ServoLostError:
        """Return the error; if the computer was suspended, an error that names this cause.

        After a suspension the servo's clock and its registers look like a supply failure, and the
        silence on this computer's clock is short.
        """
        seconds = self._suspension.seconds()
        if not seconds:
            return error
        return type(error)(
            f"The computer was suspended for {seconds:.3g} s while the {self._name} had torque, so "
            "its Bus Watchdog has dropped it: keep the computer awake, then start again."
        )
