"""Drives several servos on one bus: reads all in one cycle, commands all in one frame.

Each servo is started and stopped by its own driver, with checks and probe. In between the group
reads them by the fastest instruction that all of them support; if a servo does not reply, only its
own reading is lost. While a group runs, health is not polled; only the alert in a reply shows a
latched hardware error.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Final

from haptic_wall.hw.clock import Clock
from haptic_wall.hw.dynamixel.servo import DynamixelServo
from haptic_wall.hw.dynamixel.together import Together, Way
from haptic_wall.hw.errors import ServoError, UnfitServoError
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import BusCounts, Check, Facts, Outcome, Reading
from haptic_wall.hw.settings import DriverSettings

_TRIES: Final = 3
_PATIENCE_NS: Final = 100_000_000


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
        self._line = line
        self._shared = _SharedLine(line)
        self._ids = ids
        self._servos = [DynamixelServo(one, self._shared) for one in settings]
        self._together = Together(line, ids, Way.SYNC)
        self._running = False

    @property
    def way(self) -> Way:
        """Return how the servos are read; ``start`` determines it."""
        return self._together.way

    @property
    def facts(self) -> list[Facts]:
        """Return the facts of each servo, constant while it is open."""
        return [servo.facts for servo in self._servos]

    @property
    def counts(self) -> list[BusCounts]:
        """Return the counts of each servo's bus traffic since the start."""
        return self._together.counts

    @property
    def restarted(self) -> list[int]:
        """Return the ids of servos that have restarted, so that their torque is off.

        The other servos go on. Stop and start the group to use all again.
        """
        return self._together.restarted

    @property
    def waited_ns(self) -> int:
        """Return the bus wait of the last ``collect`` [ns]."""
        return self._together.waited_ns

    def start(self) -> list[list[Check]]:
        """Check and set up each servo in sequence; then determine how to read them.

        Returns:
            The checks of each servo.

        Raises:
            ServoError: A servo could not be started; the torque of all servos is off.
        """
        checks: list[list[Check]] = []
        try:
            for servo in self._servos:
                checks.append(servo.start())  # a failed start switches its torque off
            self._together = self._quickest()
            for servo in self._servos:
                servo.resume()  # the first ones may have been idle for long
        except BaseException as error:
            if not _stopped(self._servos[: len(checks)]) and isinstance(error, ServoError):
                raise type(error)(
                    f"{error} Torque off of another could not be read back: switch the power off."
                ) from error
            raise
        self._running = True
        return checks

    def request(self) -> None:
        """Request all positions, without waiting.

        Raises:
            ServoLostError: The port is gone.
        """
        self._together.request()

    def collect(self, deadline_ns: int) -> list[Reading]:
        """Return the replies to the last ``request``; wait until ``deadline_ns`` [ns] at most.

        Raises:
            ServoLostError: The port is gone.
            TorqueLostError: A servo that did not reply for a while has lost its torque.
        """
        samples = self._together.collect(deadline_ns)
        readings = []
        for servo, sample, counts in zip(self._servos, samples, self._together.counts, strict=True):
            reading = servo.read_from(sample)
            counts.refused += reading.outcome is Outcome.REFUSED
            readings.append(reading)
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
        goals = [servo.goal(torque) for servo, torque in zip(self._servos, torques, strict=True)]
        self._together.send_currents(goals)
        return [servo.torque(goal) for servo, goal in zip(self._servos, goals, strict=True)]

    def stop(self) -> bool:
        """Send zero torque to all at once; then switch each torque off and read it back.

        Returns:
            Whether torque off was read back from all.
        """
        if self._running:
            self._running = False
            with suppress(ServoError):  # torque off, which follows, is what counts
                self._together.send_currents([0] * len(self._servos))
        return _stopped(self._servos)

    def close(self) -> None:
        """Stop all servos, and close the line."""
        try:
            self.stop()
        finally:
            self._line.close()

    def _quickest(self) -> Together:
        """Return the fastest instruction to which all servos reply."""
        for way in Way:
            together = Together(self._line, self._ids, way)
            for _ in range(_TRIES):
                together.request()
                samples = together.collect(self._line.clock.now_ns() + _PATIENCE_NS)
                if all(sample.outcome is Outcome.OK for sample in samples):
                    together.counts = [BusCounts() for _ in self._ids]
                    return together
        raise UnfitServoError(
            "The servos answer one by one but not in one cycle",
            advice="check the cable, and that no two have the same id.",
        )


class _SharedLine:
    """A line that several drivers use in turn; the group closes it."""

    def __init__(self, line: Line) -> None:
        self.clock: Clock = line.clock
        self.write = line.write
        self.read = line.read
        self.wait = line.wait

    def close(self) -> None:
        """Do nothing: the group closes the line."""


def _stopped(servos: Sequence[DynamixelServo]) -> bool:
    """Stop every servo, even if another one fails; return whether all read back torque off."""
    stopped = [servo.stop() for servo in servos]
    return all(stopped)
