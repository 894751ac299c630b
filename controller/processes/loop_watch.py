"""Judges from its heartbeat whether the loop is alive, allowing for suspensions of the observer."""

from __future__ import annotations

from haptic_wall.controller.runtime.telemetry import LoopState, Word

START_S = 60.0
"""Time allowed for a process to start [s]: the loop does the guard's mathematics meanwhile."""
END_S = 2.0
"""Time allowed for a process to end after a request [s]."""
REPORT_S = 15.0
"""Time allowed for a loop to end after it has read torque off back [s]: computing its report takes
seconds on a small machine, and the torque is already off."""
AWAY_S = 0.06
"""A gap this long between two looks [s] means that this process was suspended, perhaps with the
loop: the loop's silence then counts from now on. The servo's Bus Watchdog works without an
observer."""


class LoopWatch:
    """Judges the loop from repeated looks at its control words, on a monotonic clock.

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
        """Record that the loop has to end; its time counts from the last look."""
        if self._asked is None:
            self._asked = self._looked

    def overdue(self, now: float) -> str | None:
        """Return the loop's failure, as words after "it"; None: it is fine.

        Args:
            now: The present time [s].
        """
        if now - self._looked > AWAY_S:
            self._awake = now
        self._looked = now
        if self._words[Word.STOP]:
            self.asked()
        state = self._words[Word.STATE]
        end_s = max(END_S, self._heartbeat_s)
        if state == LoopState.TORQUE_OFF:
            end_s = REPORT_S
        if self._asked is not None and now - max(self._asked, self._awake) > end_s:
            return f"did not end within {end_s:g} s of being asked to"
        if state <= LoopState.STARTING:
            if now - self._started > START_S:
                return f"did not start within {START_S:g} s"
            return None
        beat_ns = self._words[Word.HEARTBEAT_NS] + self._words[Word.OFFSET_NS]
        silent = now - max(beat_ns * 1e-9, self._awake)
        if state == LoopState.RUNNING:
            if silent > self._heartbeat_s:
                return f"gave no sign of life for {silent:.2g} s"
        elif silent > end_s:  # it has left the grid and only has to end
            return f"did not end within {end_s:g} s of its last period"
        return None
