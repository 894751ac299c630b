"""Switches the torque off in place of a loop that cannot, and says whether it is off."""

from __future__ import annotations

import signal
from collections.abc import Sequence

from haptic_wall.controller.processes.children import Child
from haptic_wall.controller.processes.loop_watch import END_S
from haptic_wall.controller.runtime.telemetry import Word
from haptic_wall.hw.clock import MonotonicClock
from haptic_wall.hw.open import cut_torque
from haptic_wall.hw.settings import ServoSettings


class TorqueCut:
    """Writes Torque Enable 0 to the bus, and nothing else.

    Args:
        servos: Settings of the servos.
        words: The control words.

    Attributes:
        port: Descriptor of the open port; None: there is none.
        confirmed: Whether torque off was read back; None: nothing had to be cut.
    """

    def __init__(self, servos: Sequence[ServoSettings], words: memoryview[int]) -> None:
        self._servos = servos
        self._words = words
        self.port: int | None = None
        self.confirmed: bool | None = None

    def now(self) -> str:
        """Switch the torque off; return a sentence on the result."""
        self._words[Word.COUPLED] = 0  # the bus waits for the loop no longer
        # Of several the last replies may be late on a busy machine; a single one is waited for.
        attempts = min(2, len(self._servos))
        self.confirmed = any(
            cut_torque(self._servos, self.port, MonotonicClock()) for _ in range(attempts)
        )
        if self._servos[0].backend == "simulated":
            return "the simulated servo ended with it"
        if self.confirmed:
            return "the supervisor switched the torque off and read it back"
        return (
            "torque off could not be read back: switch the servo's power off; its Bus Watchdog "
            "should have stopped it"
        )

    def take_from(self, loop: Child, overdue: str = "") -> str:
        """Take the bus from a dead or hung loop, which cannot write on it any more.

        Args:
            loop: The loop's process.
            overdue: The loop's failure, as words after "it"; empty: the loop is dead.

        Returns:
            What happened, for people.
        """
        doing = loop.doing()
        self._words[Word.CUT] = 1
        loop.send(signal.SIGKILL)  # a loop that only seems hung must not write during the cut
        text = self.now()
        loop.wait(END_S)
        what = f"{overdue}{f' (it {doing})' if doing else ''} and was killed"
        return f"the loop's process {what if overdue else loop.exit_text()}; {text}"
