"""Keeps somebody writing the log: where a recorder dies or stands still, another one goes on.

The rows of the last minute are in shared memory, so that nothing is lost meanwhile.
"""

from __future__ import annotations

import json
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
"""From the start of one recorder to that of the next [s], at least, after one death and after many:
recorders that cannot live must not keep the machine busy."""
STUCK_S = 10.0
"""How long a recorder may write nothing while half of the memory waits for it [s]."""
LAST_S = 5.0
"""How long a recorder may write nothing when the run is over [s]."""
LAST_ATTEMPTS = 3


class LogKeeper:
    """Sees to it that rows are written, during the run and after it.

    Args:
        start: Starts a recorder; True: to go on with the log of a dead one.
        words: The control words.
        tell: Called at once with what a person should know.
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
        self._hurried = False
        self._dying: Child | None = None
        self._tail = 0
        self._trouble: str | None = None
        self._lost: str | None = None
        self._losing = False
        self._deaths: Counter[str] = Counter()

    @property
    def lacking(self) -> int | None:
        """How many rows the log lacks; None: nobody knows, since part of it is lost."""
        return rows_lacking(self._words) if self._lost is None else None

    def look(self, now: float) -> None:
        """Look after the recorder; waits for nothing but the start of another where one is due.

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
            self._tell(
                "rows are being lost from the log: more wait to be written than memory holds"
            )
        if waiting <= CAPACITY // 2 or self._trouble is not None:
            self._kept_up = now
        if self._recorder is not None:
            if self._recorder.ended():
                self._bury(self._recorder.exit_text())
            elif now - max(self._kept_up, self._begun) > STUCK_S:
                self._replace(now)
        pause = min(AGAIN_MOST_S, AGAIN_S * self._deaths.total())
        if self._recorder is None and self._gone(0.0) and now - self._begun > pause:
            self._start_another(now)

    def _replace(self, now: float) -> None:
        """End a recorder that has half of the memory wait for it."""
        if now - max(self._moved, self._begun) > STUCK_S:
            self._bury(f"had written nothing for {now - self._moved:.0f} s")
        elif not self._hurried:
            # One that stood back may have been starved; if the next is slow too, the disk is.
            self._hurried = True
            self._bury(f"did not keep up for {now - self._kept_up:.0f} s")

    def end(self) -> list[str]:
        """No more rows will come: have the last ones written; what a person should know."""
        words = self._words
        words[Word.FINISHED] = 1
        for _ in range(LAST_ATTEMPTS):
            if not self._gone(LAST_S):
                break
            if self._recorder is None:
                self._start_another(time.monotonic())
            if self._recorder is None:
                continue
            how = self._see_to_its_end()
            self._hear()
            written = words[Word.TAIL] == words[Word.HEAD]
            if self._trouble is None and not (written and how is None):
                self._bury(how or "ended too soon")
            if self._trouble is not None or written:
                break
        return self._notes()

    def close(self) -> None:
        """Leave no recorder behind, whatever has happened."""
        self._words[Word.FINISHED] = 1
        self._see_to_its_end()
        for recorder in (self._recorder, self._dying):
            if recorder is not None:
                recorder.dismiss(0.0)

    def _see_to_its_end(self) -> str | None:
        """Wait for the recorder while it gets on; how it ended where that was not well."""
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

    def _bury(self, how: str) -> None:
        if self._recorder is not None:
            self._hear()
            self._recorder.send(signal.SIGKILL)
            # One that waits for a disk in the kernel does not even die. Nobody waits for that here,
            # and nobody else writes the log until it is dead.
            self._dying, self._recorder = self._recorder, None
        self._trouble = None
        self._deaths[how] += 1
        if not self._words[Word.FINISHED]:
            self._tell(f"the recorder {how}; another one goes on with the log")

    def _gone(self, timeout_s: float) -> bool:
        """Whether the recorder that was killed last is dead; waits for it up to ``timeout_s``."""
        if self._dying is not None and self._dying.wait(timeout_s):
            self._dying.dismiss(0.0)
            self._dying = None
        return self._dying is None

    def _start_another(self, now: float) -> None:
        self._begun = now
        try:
            self._recorder = self._start(True)
        except OSError as error:  # no memory, too many processes: later perhaps
            self._bury(f"could not be started ({error.strerror})")

    def _hear(self) -> None:
        """What the recorder says of its trouble with the disk."""
        for line in [] if self._recorder is None else self._recorder.lines():
            said = json.loads(line)
            if "lost" in said:
                self._hear_of_loss(said["lost"])
                continue
            trouble = said["trouble"]
            if trouble is not None and self._trouble is None:
                self._tell(
                    f"the log cannot be written ({trouble}); make room: the last {CAPACITY} rows"
                    " are kept until it can"
                )
            elif trouble is None and self._trouble is not None:
                self._tell("the log is written again")
            self._trouble = trouble

    def _hear_of_loss(self, lost: str) -> None:
        """For good: it is said once, and the next rows are taken as if nothing had been."""
        if self._lost is None:
            self._lost = lost
            if not self._words[Word.FINISHED]:
                self._tell(f"part of the log is lost ({lost}); the run goes on")

    def _notes(self) -> list[str]:
        head, tail = self._words[Word.HEAD], self._words[Word.TAIL]
        missing = rows_lacking(self._words)
        well = "; another one went on, and no row is missing from the log"
        if missing or self._lost is not None:
            well = ""
        notes = [
            f"the recorder {how}{f' ({times} times)' if times > 1 else ''}{well}"
            for how, times in self._deaths.items()
        ]
        if missing:
            why = self._trouble or "more rows waited to be written than memory holds"
            if tail != head and self._trouble is None:
                why = "no recorder came to write its end"
            notes.append(
                f"the log is incomplete ({why}): it lacks {missing} of {head} rows; the run was"
                " not disturbed"
            )
        if self._lost is not None:
            notes.append(
                f"part of the log is lost ({self._lost}), and nobody knows which rows; the run was"
                " not disturbed"
            )
        return notes
