"""Is the loop alive? Judged from its heartbeat, by somebody who may have been away himself."""

from __future__ import annotations

from haptic_wall.controller.runtime.telemetry import State, Word

START_S = 60.0
"""How long the loop may take to start [s]: the checked start-up, and the guard's mathematics."""
END_S = 2.0
"""How long a process may take to end after it was asked to [s]."""
REPORT_S = 15.0
"""The same of a loop that has read torque off back [s]: it computes its report, which takes a small
machine seconds, and there is nothing left to cut."""
AWAY_S = 0.06
"""Who looks so seldom [s] has been stopped himself, perhaps with the loop: its silence counts from
now on. The servo's Bus Watchdog needs no one to look."""


class LoopWatch:
    """Looks at the loop again and again, on a monotonic clock.

    Args:
        words: The control words.
        heartbeat_s: How long the loop may be silent on its grid [s].
        now: The present time [s].
    """

    def __init__(self, words: memoryview[int], heartbeat_s: float, now: float) -> None:
        self._words = words
        self._heartbeat_s = heartbeat_s
        self._started = now
        self._looked = now
        self._awake = now
        self._asked: float | None = None

    def asked(self) -> None:
        """The loop was asked to end, or has reason to; counts from the last look on."""
        if self._asked is None:
            self._asked = self._looked

    def overdue(self, now: float) -> str | None:
        """What the loop has failed to do, to go behind "it"; None: nothing is wrong with it.

        Args:
            now: The present time [s].
        """
        if now - self._looked > AWAY_S:
            self._awake = now
        self._looked = now
        if self._words[Word.STOP]:
            self.asked()
        state = self._words[Word.STATE]
        end_s = REPORT_S if state == State.TORQUE_OFF else END_S
        if self._asked is not None and now - max(self._asked, self._awake) > end_s:
            return f"did not end within {end_s:g} s of being asked to"
        if state == State.STARTING:
            if now - self._started > START_S:
                return f"did not start within {START_S:g} s"
            return None
        silent = now - max(self._words[Word.HEARTBEAT_NS] * 1e-9, self._awake)
        if state == State.RUNNING:
            if silent > self._heartbeat_s:
                return f"gave no sign of life for {silent:.2g} s"
        elif silent > end_s:  # it has left the grid, and has nothing to do but to end
            return f"did not end within {end_s:g} s of its last period"
        return None
