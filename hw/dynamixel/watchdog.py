"""Examines the Bus Watchdog after a pause, and arms it again if no torque was lost."""

from __future__ import annotations

from typing import Final

from haptic_wall.hw.clock import Clock, Suspension
from haptic_wall.hw.dynamixel.register_access import QUICK_NS, confirmed, lost, read_patiently
from haptic_wall.hw.dynamixel.registers import WATCHDOG_TRIPPED, WATCHDOG_UNIT_NS
from haptic_wall.hw.dynamixel.station import Station
from haptic_wall.hw.dynamixel.tables import REGISTERS
from haptic_wall.hw.errors import ServoLostError, TorqueLostError, UnfitServoError
from haptic_wall.hw.settings import DriverSettings

_TORQUE_ENABLE: Final = REGISTERS["torque_enable"]
_BUS_WATCHDOG: Final = REGISTERS["bus_watchdog"]
_GOAL_CURRENT: Final = REGISTERS["goal_current"]
_MOST_UNITS: Final = 127
_NEVER_NS: Final = 1 << 62


def watchdog_units(settings: DriverSettings) -> int:
    """Return the configured Bus Watchdog in the register's unit.

    Raises:
        UnfitServoError: The register cannot hold it.
    """
    units = round(settings.watchdog_s * 1e9 / WATCHDOG_UNIT_NS)
    if not 1 <= units <= _MOST_UNITS:
        raise UnfitServoError(
            f"A Bus Watchdog of {settings.watchdog_s:g} s is requested, but servos "
            "have 0.02 to 2.54 s",
            advice="set servo.watchdog_s in this range.",
        )
    return units


def rearm(station: Station, units: int, *, under_torque: bool) -> bool | None:
    """Check whether the servo still accepts goals; arm it again if no torque was lost.

    A tripped watchdog silently refuses every goal. Under torque it is left tripped: the return of
    the torque after an unobserved motion would be an impact. It is written only after it was read.

    A tripped watchdog accepts no goal before it is cleared, and the old torque may then return with
    nothing to end it: so torque is off meanwhile. Every write is read back.

    Args:
        station: The servo.
        units: Its setting [20 ms].
        under_torque: The last goal was not zero.

    Returns:
        Whether it has its setting, perhaps armed again at zero torque; False: it has tripped or was
        changed, and there was a torque to lose; None: the servo does not reply.

    Raises:
        ServoLostError: The port is gone.
    """
    found = read_patiently(station, _BUS_WATCHDOG, QUICK_NS)
    if found is None:  # unknown whether there is a torque to lose
        return None
    if found == units:
        return True
    if under_torque:
        return False
    steps = [(_GOAL_CURRENT, 0), (_BUS_WATCHDOG, units)]
    if found == WATCHDOG_TRIPPED:
        steps = [(_TORQUE_ENABLE, 0), (_BUS_WATCHDOG, 0), *steps, (_TORQUE_ENABLE, 1)]
    armed = all(
        confirmed(station, register, value, 3 * QUICK_NS[-1:]) == value for register, value in steps
    )
    return armed or None


class WatchdogMonitor:
    """Examines the Bus Watchdog of one servo after a pause in which it may have tripped.

    Args:
        settings: Contains the time of the Bus Watchdog.
        station: The servo.
        clock: Tells the time.
        name: Name of the servo, for messages.

    Raises:
        UnfitServoError: No servo has such a Bus Watchdog.
    """

    __slots__ = (
        "_clock",
        "_name",
        "_station",
        "_suspension",
        "_units",
        "_watchdog_s",
        "called_ns",
        "heard_ns",
        "limit_ns",
        "most_ns",
    )

    def __init__(self, settings: DriverSettings, station: Station, clock: Clock, name: str) -> None:
        self._units = watchdog_units(settings)
        self._watchdog_s = settings.watchdog_s
        self._station = station
        self._clock = clock
        self._name = name
        self._suspension = Suspension(clock)
        self.heard_ns = 0
        """When the last answered request was sent [ns]"""
        self.called_ns = 0
        """When the last request was sent, where a reply takes several periods [ns]"""
        self.most_ns = _NEVER_NS
        """Pause after which the Bus Watchdog may have tripped [ns]; not reached before ``begin``"""
        self.limit_ns = _NEVER_NS
        """The same since the last answered request, with the time that an answer may take [ns]"""

    def begin(self) -> None:
        """Start monitoring: the torque is on from now."""
        self.called_ns = self._clock.now_ns()
        self._suspension = Suspension(self._clock)
        # The watchdog counts whole units, so that one set to two may trip soon after the first.
        self.most_ns = self.limit_ns = round(max(self._units - 1, 0.75) * WATCHDOG_UNIT_NS)

    def end(self) -> None:
        """Stop monitoring: the torque is off from now, and pauses may have any length."""
        self.most_ns = self.limit_ns = _NEVER_NS

    def resume(self, now_ns: int, *, under_torque: bool) -> None:
        """Examine the Bus Watchdog if the last answered request is too long ago; see ``look``."""
        silence_ns = now_ns - self.heard_ns
        if silence_ns > self.limit_ns:
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
        armed = rearm(self._station, self._units, under_torque=under_torque)
        if not armed:
            raise self.explained(self._lost(armed, silence_ns))

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

    def _lost(self, armed: bool | None, silence_ns: int) -> ServoLostError:
        """Return the error for a watchdog that was not armed."""
        silence = f"{silence_ns * 1e-6:.0f} ms"
        if armed is None:
            return lost(
                self._station,
                self._name,
                f"The {self._name} no longer answers, after {silence} without an answered request",
                ": a servo that restarts is silent meanwhile",
            )
        if not silence_ns:
            return TorqueLostError(
                f"The Bus Watchdog of the {self._name} has another setting than the driver wrote",
                advice="look for another program on this bus.",
            )
        return TorqueLostError(
            f"The {self._name} heard nothing for {silence}, so its Bus Watchdog "
            f"({self._watchdog_s * 1e3:.0f} ms) has dropped the torque",
            advice="find the cause of this machine's stalls, or raise servo.watchdog_s.",
        )
