"""Record of a bus for its witness: frames, faults, motion, each with the truth at that instant."""

from __future__ import annotations

from collections.abc import Sequence

from haptic_wall.hw.dynamixel.codec import BROADCAST, Frame
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.emulated.witness import Row, Witness


class Account:
    """Tells ``witness`` of what happens on a bus.

    Args:
        witness: Who is told; None: nobody.
        servos: Who is on the bus.
    """

    def __init__(self, witness: Witness | None, servos: Sequence[EmulatedServo]) -> None:
        self._witness = witness
        self._servos = servos

    def frame(self, now_ns: int, event: str, frame: Frame, ids: Sequence[int] | None) -> None:
        """A frame, with the state of the first servo it concerns; ``ids`` None: all."""
        if self._witness is not None:
            state = self._concerned(ids[0] if ids else None).state(now_ns)
            self._witness.add(
                Row(now_ns, event, frame.id, frame.instruction, state, frame.error, frame.params)
            )

    def fault(self, now_ns: int, name: str, id_: int | None, instruction: int | None) -> None:
        """A fault; ``id_`` None: it is nobody's."""
        if self._witness is not None:
            state = self._concerned(id_).state(now_ns)
            shown = BROADCAST if id_ is None else id_
            self._witness.add(Row(now_ns, "fault", shown, instruction, state, None, b"", name))

    def states(self, now_ns: int) -> None:
        """Where every servo is."""
        if self._witness is not None:
            for servo in self._servos:
                state = servo.state(now_ns)
                self._witness.add(Row(now_ns, "state", servo.id, None, state, None, b""))

    def _concerned(self, id_: int | None) -> EmulatedServo:
        return next((servo for servo in self._servos if servo.id == id_), self._servos[0])
