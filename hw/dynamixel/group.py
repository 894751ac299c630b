"""Drives several servos on one bus: reads all in one cycle, commands all in one frame.

They are read by the fastest instruction that all of them support; if a servo does not reply, only
its own reading is lost. Any servo that is lost for too long, is hot, has restarted, has latched an
error or has lost its torque ends the run of all: zero torque in the next frame, then torque off.
"""

from __future__ import annotations

from collections.abc import Sequence

from haptic_wall.hw.dynamixel.drive import Drive
from haptic_wall.hw.dynamixel.samples import Way
from haptic_wall.hw.errors import ServoError, ServoHealthError, UnfitServoError
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import BusCounts, Check, Facts, Reading
from haptic_wall.hw.settings import DriverSettings


class DynamixelGroup:
    """Servos on a line, in the order of their settings.

    Args:
        settings: Settings of each servo; the ids must differ.
        line: The bus; ``close`` closes it.

    Raises:
        UnfitServoError: Two servos have the same id, or a model has no current control.
    """

    def __init__(self, settings: Sequence[DriverSettings], line: Line) -> None:
        ids = [one.id for one in settings]
        if not ids or len(set(ids)) != len(ids):
            raise UnfitServoError(
                f"A group needs servos with an id each, but has {ids}",
                advice="give each another one.",
            )
        self._drive = Drive(settings, line)

    @property
    def way(self) -> Way:
        """Return how the servos are read; ``start`` determines it."""
        return self._drive.exchange.way

    @property
    def facts(self) -> list[Facts]:
        """Return the facts of each servo, constant while it is open."""
        return [one.facts for one in self._drive.servos]

    @property
    def counts(self) -> list[BusCounts]:
        """Return the counts of each servo's bus traffic since the start."""
        return [one.bus.counts for one in self._drive.servos]

    @property
    def waited_ns(self) -> int:
        """Return the bus wait of the last ``collect`` [ns]."""
        return self._drive.exchange.waited_ns

    def start(self) -> list[list[Check]]:
        """Check and set up each servo in sequence; then determine how to read them.

        Returns:
            The checks of each servo.

        Raises:
            ServoError: A servo could not be started; the torque of all servos is off, or the
                message says of which it may not be.
        """
        return self._drive.start()

    def request(self) -> None:
        """Request all positions, without waiting unless a Bus Watchdog may have tripped.

        Raises:
            ServoError: As ``collect``.
        """
        try:
            self._drive.request()
        except ServoError as error:
            raise self._all_off(error) from error

    def collect(self, deadline_ns: int) -> list[Reading]:
        """Return the replies to the last ``request``; wait until ``deadline_ns`` [ns] at most.

        Raises:
            ServoError: The port is gone, or a servo is lost, has lost its torque or is in no state
                to be driven any longer. The torque of all is off, or the message says of which it
                may not be.
        """
        try:
            readings = self._drive.collect(deadline_ns)
            for one, reading in zip(self._drive.servos, readings, strict=True):
                if reading.alert:
                    raise ServoHealthError(f"The {one.facts.name} reports a hardware error.")
        except ServoError as error:
            raise self._all_off(error) from error
        return readings

    def write(self, torques: Sequence[float]) -> list[float]:
        """Send the torques of all servos [N·m] in one frame, limited and rounded.

        Returns:
            The torques really sent [N·m].

        Raises:
            ServoLostError: The port is gone.
            ValueError: A torque is not a finite number, or there is not one for each.
            RuntimeError: The group is not started.
        """
        return self._drive.write(torques)

    def stop(self) -> bool:
        """Send zero torque to all at once, switch their torques off and read them back.

        Returns:
            Whether torque off was read back from all.
        """
        return self._drive.stop()

    def close(self) -> None:
        """Stop all servos, and close the line."""
        self._drive.close()

    def _all_off(self, error: ServoError) -> ServoError:
        """Switch all torques off; return the error, with what else is wrong."""
        drive = self._drive
        drive.stop()
        told = [str(error)]
        told += [f"T{one.trouble[1:]}." for one in drive.servos if one.trouble]
        if drive.left_on:
            names = ", ".join(one.facts.name for one in drive.left_on)
            told.append(f"Torque off of {names} could not be read back: switch the power off.")
        return type(error)(" ".join(told))
