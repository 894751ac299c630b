"""Writes the events of a bus (frames, faults, motion) to its witness, each with the true state."""

from __future__ import annotations

from collections.abc import Sequence

from haptic_wall.hw.dynamixel.codec import BROADCAST, Frame
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.emulated.witness import Event, Witness


class WitnessRows:
    """Converts the events of a bus to rows of its witness.

    Args:
        witness: Receives the rows; None: no record is made.
        servos: The servos on the bus.
    """

    def __init__(self, witness: Witness | None, servos: Sequence[EmulatedServo]) -> None:
        self._witness = witness
        self._servos = servos

    def frame(self, now_ns: int, event: str, frame: Frame, ids: Sequence[int] | None) -> None:
        """Record a frame, with the state of the first servo it concerns; ``ids`` None: all."""
        if self._witness is not None:
            state = self._concerned(ids[0] if ids else None).state(now_ns)
            self._witness.add(
                Event(now_ns, event, frame.id, frame.instruction, state, frame.error, frame.params)
            )

    def fault(self, now_ns: int, name: str, id_: int | None, instruction: int | None) -> None:
        """Record a fault; ``id_`` None: it concerns no servo."""
        if self._witness is not None:
            state = self._concerned(id_).state(now_ns)
            shown = BROADCAST if id_ is None else id_
            self._witness.add(Event(now_ns, "fault", shown, instruction, state, None, b"", name))

    def states(self, now_ns: int) -> None:
        """Record the state of every servo."""
        if self._witness is not None:
            for servo in self._servos:
                state = servo.state(now_ns)
                self._witness.add(Event(now_ns, "state", servo.id, None, state, None, b""))

    def _concerned(self, id_: int | None) -> EmulatedServo:
        return next((servo for servo in self._servos if servo.id == id_), self._servos[0])
