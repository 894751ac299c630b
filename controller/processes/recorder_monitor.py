"""Restarts the recorder when it dies or hangs.

Shared memory holds the rows of the last minute, so that no row is lost in between.
"""

from __future__ import annotations

import signal
import time
from collections import Counter
from collections.abc import Callable

from haptic_wall.controller.processes.children import Child
from haptic_wall.controller.processes.plan import Tell
from haptic_wall.controller.processes.recorder import rows_lacking
from haptic_wall.controller.runtime.telemetry import CAPACITY, Word

AGAIN_S = 1.0
AGAIN_MOST_S = 10.0
"""Least time between the starts of two recorders [s], after one death and after many: recorders
that keep dying must not load the machine."""
STUCK_S = 10.0
"""How long a recorder may write nothing while half of the memory is full [s]."""
LAST_S = 5.0
"""How long a recorder may write nothing after the run is over [s]."""
LAST_ATTEMPTS = 3


class RecorderMonitor:
    """Keeps a recorder running, during the run and until its last rows are written.

    Args:
        start: Starts a recorder; True: it continues the log of a dead one.
        words: The control words.
        tell: Called at once with messages for a person.
        now: The present time [s].
    """

    def __init__(
        self,
        start: Callable[[bool], Child],
        words: memoryview[int],
        tell: Tell,
        now: float,
    ) -> None:
        self._start = start
        self._words = words
        self._tell = tell
        self._recorder: Child | None = start(False)
        self._begun = now
        self._moved = now
        self._kept_up = now
        self._dying: Child | None = None
        self._tail = 0
        self._trouble: str | None = None
        self._lost: str | None = None
        self._losing = False
        self._deaths: Counter[str] = Counter()

    @property
    def lacking(self) -> int | None:
        """Return the number of rows missing from the log; None: unknown, part of it is lost."""
        return rows_lacking(self._words) if self._lost is None else None

    def look(self, now: float) -> None:
        """Check the recorder, and start another one where necessary; waits only for that start.

        Args:
            now: The present time, on a monotonic clock [s].
        """
        self._hear()
        words = self._words
        if words[Word.TAIL] != self._tail:
            self._tail, self._moved = words[Word.TAIL], now
        waiting = words[Word.HEAD] - words[Word.TAIL]
        if waiting > CAPACITY and not self._losing:
            self._losing = True
            self._tell("the log loses rows: more rows wait to be written than memory holds")
        if waiting <= CAPACITY // 2 or self._trouble is not None:
            self._kept_up = now
        if self._recorder is not None:
            if self._recorder.ended():
                self._abandon(self._recorder.exit_text())
            elif now - max(self._moved, self._kept_up, self._begun) > STUCK_S:
                self._abandon(f"had written nothing for {now - self._moved:.0f} s")
        pause = min(AGAIN_MOST_S, AGAIN_S * self._deaths.total())
        if self._recorder is None and self._is_dead(0.0) and now - self._begun > pause:
            self._start_another(now)

    def end(self) -> list[str]:
        """Have the last rows of the run written; return messages for a person."""
        words = self._words
        words[Word.FINISHED] = 1
        for _ in range(LAST_ATTEMPTS):
            if not self._is_dead(LAST_S):
                break
            if self._recorder is None:
                self._start_another(time.monotonic())
            if self._recorder is None:
                continue
            how = self._await_end()
            self._hear()
            written = words[Word.TAIL] == words[Word.HEAD]
            if self._trouble is None and not (written and how is None):
                self._abandon(how or "ended too soon")
            if self._trouble is not None or written:
                break
        return self._notes()

    def close(self) -> None:
        """End every recorder that still exists."""
        self._words[Word.FINISHED] = 1
        self._await_end()
        for recorder in (self._recorder, self._dying):
            if recorder is not None:
                recorder.dismiss(0.0)

    def _await_end(self) -> str | None:
        """Wait while the recorder makes progress; return how it failed, or None."""
        recorder = self._recorder
        if recorder is None:
            return None
        tail = -1
        while not recorder.ended() and self._words[Word.TAIL] != tail:
            tail = self._words[Word.TAIL]
            recorder.wait(LAST_S)
        if not recorder.ended():
            return f"had written nothing for {LAST_S:g} s"
        return None if recorder.well() else recorder.exit_text()

    def _abandon(self, how: str) -> None:
        if self._recorder is not None:
            self._hear()
            self._recorder.send(signal.SIGKILL)
            # A process that waits for a disk in the kernel cannot be killed. This one is not waited
            # for, and no other recorder starts until it is dead.
            self._dying, self._recorder = self._recorder, None
        self._trouble = None
        self._deaths[how] += 1
        if not self._words[Word.FINISHED]:
            self._tell(f"the recorder {how}; another one continues the log")

    def _is_dead(self, timeout_s: float) -> bool:
        """Whether the recorder killed last is dead; waits for it up to ``timeout_s``."""
        if self._dying is not None and self._dying.wait(timeout_s):
            self._dying.dismiss(0.0)
            self._dying = None
        return self._dying is None

    def _start_another(self, now: float) -> None:
        self._begun = now
        try:
            self._recorder = self._start(True)
        except OSError as error:  # no memory or too many processes: tried again later
            self._abandon(f"could not be started ({error.strerror})")

    def _hear(self) -> None:
        """Process the recorder's messages about its trouble with the disk."""
        for said in [] if self._recorder is None else self._recorder.said():
            if "lost" in said:
                self._note_loss(said["lost"])
                continue
            trouble = said["trouble"]
            if trouble is not None and self._trouble is None:
                room = "; make room" if said["full"] else ""
                self._tell(
                    f"the log cannot be written ({trouble}){room}: the last {CAPACITY} rows are"
                    " kept until it can"
                )
            elif trouble is None and self._trouble is not None:
                self._tell("the log is written again")
            self._trouble = trouble

    def _note_loss(self, lost: str) -> None:
        """Record a permanent loss, and report the first one."""
        if self._lost is None:
            self._lost = lost
            if not self._words[Word.FINISHED]:
                self._tell(f"part of the log is lost ({lost}); the run goes on")

    def _notes(self) -> list[str]:
        head, tail = self._words[Word.HEAD], self._words[Word.TAIL]
        missing = rows_lacking(self._words)
        well = "; another one continued, and no row is missing from the log"
        if missing or self._lost is not None:
            well = ""
        notes = [
            f"the recorder {how}{f' ({times} times)' if times > 1 else ''}{well}"
            for how, times in self._deaths.items()
        ]
        if missing:
            why = self._trouble or "more rows waited to be written than memory holds"
            if tail != head and self._trouble is None:
                why = "no recorder wrote its end"
            notes.append(
                f"the log is incomplete ({why}): it lacks {missing} of {head} rows; the run was"
                " not disturbed"
            )
        if self._lost is not None:
            notes.append(
                f"part of the log is lost ({self._lost}), and the lost rows are not known; the run"
                " was not disturbed"
            )
        return notes
