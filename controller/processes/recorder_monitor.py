"""Restarts the recorder when it dies, and at the end of the run when it hangs.

Shared memory holds the rows of the last minute, so that no row is lost in between.
"""

from __future__ import annotations

import os
import socket
import time
from collections import Counter
from collections.abc import Callable

from haptic_wall.controller.processes.children import Child
from haptic_wall.controller.processes.plan import Plan, Tell
from haptic_wall.controller.processes.recorder import rows_lacking
from haptic_wall.controller.runtime.telemetry import CAPACITY, Word

AGAIN_MOST_S = 10.0
"""Longest pause before another recorder [s], one second for each that has died: recorders that keep
dying must not load the machine."""
LAST_S = 5.0
"""How long a recorder may write nothing after the run is over [s]."""
LAST_ATTEMPTS = 3


def recorder_starter(
    plan: Plan, telemetry: int, events: socket.socket, cores: set[int]
) -> Callable[[], Child]:
    """Return what starts a recorder of a run, the first one and others.

    Args:
        plan: The run.
        telemetry: Descriptor of the shared memory.
        events: Source of the changes of the running wall.
        cores: Cores on which it runs.
    """
    orders = {
        "telemetry": telemetry,
        "parent": os.getpid(),
        "log": str(plan.log),
        "axes": plan.axes,
        "period_ns": plan.config.period_ns,
        "metadata": plan.metadata,
        "force": plan.force,
        "events": events.fileno(),
    }
    module = "haptic_wall.controller.processes.recorder"
    descriptors = (telemetry, events.fileno())
    return lambda: Child("recorder", [module], orders, descriptors, cores)


class RecorderMonitor:
    """Keeps a recorder running, during the run and until its last rows are written.

    Args:
        start: Starts a recorder, which continues the log of a dead one.
        words: The control words.
        tell: Called at once with messages for a person.
        now: The present time [s].
    """

    def __init__(
        self, start: Callable[[], Child], words: memoryview[int], tell: Tell, now: float
    ) -> None:
        self._start = start
        self._words = words
        self._tell = tell
        self._recorder: Child | None = start()
        self._begun = now
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
        if words[Word.HEAD] - words[Word.TAIL] > CAPACITY and not self._losing:
            self._losing = True
            self._tell("the log loses rows: more rows wait to be written than memory holds")
        if self._recorder is not None and self._recorder.ended():
            self._bury(self._recorder.exit_text())
        pause = min(AGAIN_MOST_S, self._deaths.total())
        if self._recorder is None and now - self._begun > pause:
            self._start_another(now)

    def end(self) -> list[str]:
        """Have the last rows of the run written; return messages for a person."""
        words = self._words
        words[Word.FINISHED] = 1
        for _ in range(LAST_ATTEMPTS):
            if self._recorder is None:
                self._start_another(time.monotonic())
            if self._recorder is None:
                continue
            how = self._await_end()
            self._hear()
            written = words[Word.TAIL] == words[Word.HEAD]
            if self._trouble is None and not (written and how is None):
                self._bury(how or "ended too soon")
            if self._trouble is not None or written or self._recorder is not None:
                break
        return self._notes()

    def close(self) -> None:
        """End the recorder, if it still exists."""
        self._words[Word.FINISHED] = 1
        self._await_end()
        if self._recorder is not None:
            self._recorder.dismiss(0.0)

    def _await_end(self) -> str | None:
        """Wait while the recorder makes progress; return how it failed, or None."""
        recorder = self._recorder
        if recorder is None or not self._words[Word.HEAD]:  # it has nothing to write
            return None
        tail = -1
        while not recorder.ended() and self._words[Word.TAIL] != tail:
            tail = self._words[Word.TAIL]
            recorder.wait(LAST_S)
        if not recorder.ended():
            return f"had written nothing for {LAST_S:g} s"
        return None if recorder.well() else recorder.exit_text()

    def _bury(self, how: str) -> None:
        """Note how a recorder failed; kill one that hangs, which a disk in the kernel may keep."""
        if self._recorder is not None:
            self._hear()
            self._recorder.dismiss(0.0)
            if self._recorder.ended():
                self._recorder = None  # else nobody may write beside it
        self._trouble = None
        self._deaths[how] += 1
        if not self._words[Word.FINISHED]:
            self._tell(f"the recorder {how}; another one continues the log")

    def _start_another(self, now: float) -> None:
        self._begun = now
        try:
            self._recorder = self._start()
        except OSError as error:  # no memory or too many processes: tried again later
            self._bury(f"could not be started ({error.strerror})")

    def _hear(self) -> None:
        """Process the recorder's messages about its trouble with the disk."""
        for said in [] if self._recorder is None else self._recorder.said():
            if "lost" in said:  # for good
                if self._lost is None and not self._words[Word.FINISHED]:
                    self._tell(f"part of the log is lost ({said['lost']}); the run goes on")
                self._lost = self._lost or said["lost"]
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

    def _notes(self) -> list[str]:
        head, tail = self._words[Word.HEAD], self._words[Word.TAIL]
        missing = rows_lacking(self._words)
        whole = not missing and self._lost is None
        well = "; another one continued, and no row is missing from the log" if whole else ""
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
