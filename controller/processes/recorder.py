"""The recorder: copies rows from shared memory into the log file, in a process of its own.

It may be slow, die, or find the disk full without an effect on the loop. Rows wait in the ring
until they can be written, and another recorder continues the log of a dead one.
"""

from __future__ import annotations

import contextlib
import signal
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.errors import LogFormatError
from haptic_wall.controller.live.log_events import take_events
from haptic_wall.controller.logs.writer import LogWriter, identity
from haptic_wall.controller.runtime.idle_window import until_idle_window
from haptic_wall.controller.runtime.realtime import die_with_parent, stand_back
from haptic_wall.controller.runtime.telemetry import Telemetry, Word
from haptic_wall.controller.system.files import is_full
from haptic_wall.controller.system.orders import read_orders, say
from haptic_wall.controller.system.signals import ended_by

PAUSE_S = 0.25
"""Time that rows gather between two blocks [s]"""
SYNC_S = 0.75
"""Time that blocks gather between two syncs to the disk [s]; a power cut loses no more than both
times, and what the disk itself takes."""
BLOCK = 500
"""Largest number of rows of all axes in a block. A backlog from a full disk is written in parts
that fit; a copy of these 80 kB reuses the process's memory, that of a larger block would be fetched
page by page."""


def rows_lacking(words: memoryview[int]) -> int:
    """Return how many of the ticks so far are not in the log."""
    return words[Word.HEAD] - words[Word.TAIL] + words[Word.LACKING]


class Recorder:
    """Moves rows from the ring into a log, from the log's last row on.

    It continues the log of a dead recorder if that is in its place, and else begins a new one; a
    control word holds which file it is.

    Args:
        telemetry: Source of the rows.
        path: The file to write.
        metadata: As ``LogWriter``.
        axes: Names of the axes.
        force: Replace a file; else one that exists is refused.
        events: Source of the changes of the running wall; None: it takes none.

    Attributes:
        log: The log; the caller closes it.

    Raises:
        OSError: As ``LogWriter``.
    """

    def __init__(
        self,
        telemetry: Telemetry,
        path: Path,
        metadata: Mapping[str, Any],
        axes: Sequence[str],
        *,
        force: bool = False,
        events: socket.socket | None = None,
    ) -> None:
        self._telemetry, self._words = telemetry, telemetry.words
        self._events = events
        self._most = max(1, BLOCK // telemetry.axes)
        ours = identity(path) == self._words[Word.LOG_FILE] != 0
        log: LogWriter | None = None
        if ours:
            with contextlib.suppress(LogFormatError):  # its first lines were not finished
                log = LogWriter(path, {}, axes, resume=True)
        if log is None:
            log = LogWriter(path, metadata, axes, force=force or ours, begun=self._note_file)
            self._words[Word.LACKING] = self._words[Word.TAIL] = 0
        self.log = log
        self._tail = self._words[Word.TAIL]
        # The writer of the last block may have died before it updated the control words.
        self._count(log.seqs_from(self._tail))

    def _note_file(self, number: int) -> None:
        self._words[Word.LOG_FILE] = number

    def drain(self) -> bool:
        """Write all waiting events and rows; return whether there were any rows.

        Raises:
            OSError: The log cannot be written; the unwritten rows stay in the ring.
        """
        if self._events is not None:
            take_events(self._events, self.log.event)
        begin, end = self._tail, self._words[Word.HEAD]
        while self._tail < end:
            block, _ = self._telemetry.read(self._tail, self._most)
            self.log.append(block)
            self._count(block[:, 0]["seq"])
        return self._tail > begin

    def _count(self, seqs: NDArray[np.int64]) -> None:
        """Record that ticks are in the log, and how many earlier ones are lost."""
        if seqs.size == 0:
            return
        words = self._words
        words[Word.LACKING] += int(seqs[-1]) + 1 - words[Word.TAIL] - seqs.size
        words[Word.TAIL] = self._tail = int(seqs[-1]) + 1


class _Attempts:
    """Writes whenever possible; reports on standard output when it fails and when it works again.

    Unwritten rows wait, and such trouble may end. Rows lost after they were written do not come
    back: that is reported as a loss.
    """

    def __init__(self, telemetry: Telemetry, orders: Mapping[str, Any]) -> None:
        self._telemetry = telemetry
        self._orders = orders
        events = orders.get("events")
        self._events = None if events is None else socket.socket(fileno=events)
        self._recorder: Recorder | None = None
        self._trouble: str | None = None
        self._synced_s = 0.0

    def write(self) -> bool:
        """Write the waiting rows; return whether there were any."""
        wrote = False
        try:
            if self._recorder is None:
                if not self._telemetry.words[Word.HEAD]:
                    return False  # a run that cannot start touches no file
                orders = self._orders
                self._recorder = Recorder(
                    self._telemetry,
                    Path(orders["log"]),
                    orders["metadata"],
                    orders["axes"],
                    force=orders.get("force", False),
                    events=self._events,
                )
            wrote = self._recorder.drain()
        except OSError as error:
            self._trouble_is(self._text(error), full=is_full(error))
            return wrote
        self._trouble_is(None)
        if time.monotonic() - self._synced_s >= SYNC_S:
            self._keep(self._recorder.log.sync)
            self._synced_s = time.monotonic()
        return wrote

    def close(self) -> None:
        """Close the log, if it was ever open."""
        if self._recorder is not None:
            self._keep(self._recorder.log.sync)
            self._keep(self._recorder.log.close)

    def _keep(self, keep: Callable[[], None]) -> None:
        """Call ``keep``, and report lost rows."""
        try:
            keep()
        except OSError as error:
            say({"lost": self._text(error)})

    def _trouble_is(self, trouble: str | None, *, full: bool = False) -> None:
        if trouble != self._trouble:
            self._trouble = trouble
            say({"trouble": trouble, "full": full})

    def _text(self, error: OSError) -> str:
        return f"{self._orders['log']}: {error.strerror or error}"


def main() -> None:
    """Record until the supervisor reports that no more rows will come."""
    orders = read_orders()
    orphaned = ended_by(signal.SIGUSR1)
    telemetry = Telemetry(orders["telemetry"], axes=len(orders["axes"]))
    stand_back()
    die_with_parent(orders["parent"], signal.SIGUSR1)
    attempts = _Attempts(telemetry, orders)
    while True:
        finished = telemetry.words[Word.FINISHED]  # read first: no row comes after it
        wrote = attempts.write()
        # Without a supervisor the loop stops soon: continue until no more rows come.
        if finished or (orphaned() and not wrote):
            break
        time.sleep(until_idle_window(telemetry.words, orders["period_ns"], PAUSE_S))
    attempts.close()


if __name__ == "__main__":
    main()
