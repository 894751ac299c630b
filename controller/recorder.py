"""The recorder: copies rows from shared memory into the log file, in a process of its own.

It may be slow, die, or find the disk full: the loop does not notice. What could not be written
is said when it ends.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

from controller.logfile import LogWriter
from controller.realtime import die_with_parent
from controller.telemetry import ROW, Telemetry, Word

PAUSE_S = 0.25
"""How long rows gather between two blocks [s]; a power cut loses no more than that."""


class Recorder:
    """Moves rows from the ring into a log.

    Args:
        telemetry: Where rows come from.
        log: Where they go.

    Attributes:
        rows: Rows written.
        unread: Rows that were overwritten before they were read.
    """

    def __init__(self, telemetry: Telemetry, log: LogWriter) -> None:
        self._telemetry = telemetry
        self._log = log
        self._tail = 0
        self.rows = 0
        self.unread = 0

    def drain(self) -> None:
        """Write all rows that are there as one block.

        Raises:
            OSError: The log cannot be written; the rows stay unread.
        """
        rows, tail = self._telemetry.read(self._tail)
        if rows.size == 0:
            return
        self._log.append(rows)
        self.rows += rows.size
        self.unread += tail - self._tail - rows.size
        self._tail = tail
        self._telemetry.words[Word.TAIL] = tail


def main() -> None:
    """Record until the supervisor says that no more rows will come."""
    orders = json.loads(sys.stdin.readline())
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # it ends when the run does, not before
    # Behind everything else: the kernel threads that carry the loop's bytes want this core too.
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    telemetry = Telemetry(orders["telemetry"])

    def finish(_signal: int, _frame: object) -> None:
        telemetry.words[Word.FINISHED] = 1

    signal.signal(signal.SIGUSR1, finish)
    die_with_parent(orders["parent"], signal.SIGUSR1)
    result: dict[str, Any] = {"error": None}
    recorder = None
    try:
        log = LogWriter(Path(orders["log"]), orders["metadata"], ROW)
        recorder = Recorder(telemetry, log)
        while not telemetry.words[Word.FINISHED]:
            time.sleep(PAUSE_S)
            recorder.drain()
        recorder.drain()
        log.close()
    except OSError as error:
        result["error"] = f"{orders['log']}: {error.strerror or error}"
    if recorder is not None:
        result |= {"rows": recorder.rows, "unread": recorder.unread}
    with contextlib.suppress(BrokenPipeError):  # the supervisor is gone
        os.write(sys.stdout.fileno(), (json.dumps(result) + "\n").encode())


if __name__ == "__main__":
    main()
