"""The recorder: copies rows from shared memory into the log file, in a process of its own.

It may be slow, die, or find the disk full: the loop does not notice. Rows wait in the ring until
they can be written, and another recorder goes on where a dead one ended.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.errors import LogFormatError
from haptic_wall.controller.logs.file import LogWriter, identity
from haptic_wall.controller.processes.lull import pause_until_lull
from haptic_wall.controller.processes.orders import read_orders
from haptic_wall.controller.runtime.realtime import die_with_parent, stand_back
from haptic_wall.controller.runtime.telemetry import ROW, Telemetry, Word
from haptic_wall.controller.system.file_kinds import LOG
from haptic_wall.controller.system.whole_file import Beside

PAUSE_S = 0.25
"""How long rows gather between two blocks [s]; a killed recorder loses no more than that."""
SYNC_S = 0.75
"""How long blocks gather until the disk is made to keep them [s]; a power cut loses no more than
both, and what the disk itself takes."""
BEHIND = 8192
"""Rows that wait where a recorder before this one did not keep up"""
BLOCK = 500
"""Rows in a block at most. What has gathered while the disk was full comes in parts that fit; and a
copy of these 80 kB lies in memory that this process has, that of more is fetched page by page."""


def rows_lacking(words: memoryview[int]) -> int:
    """How many of the rows that there were until now are not in the log.

    Args:
        words: The control words.
    """
    return words[Word.HEAD] - words[Word.TAIL] + words[Word.LACKING]


def begun_log(
    path: Path, metadata: Mapping[str, Any], *, force: bool, writer: int | None = None
) -> LogWriter:
    """A log that replaces what is at ``path`` when it has its first rows.

    Args:
        path: Where to.
        metadata: As for ``LogWriter``.
        force: Replace whatever is there.
        writer: As for ``Beside``.

    Raises:
        OSError: It cannot be written.
    """
    beside = Beside(path, LOG, force=force, writer=writer)
    return LogWriter(path, metadata, ROW, beside)


class Recorder:
    """Moves rows from the ring into a log, from the log's last row on.

    Args:
        telemetry: Where rows come from.
        log: Where they go.
    """

    def __init__(self, telemetry: Telemetry, log: LogWriter) -> None:
        self._telemetry = telemetry
        self._log = log
        self._tail = 0
        if log.found is None:
            telemetry.words[Word.LACKING] = 0
        else:
            # Who wrote the last block may have died before it could tell.
            self._count(log.found[log.found["seq"] >= telemetry.words[Word.TAIL]])
            self._tail = int(log.found["seq"][-1]) + 1
        telemetry.words[Word.TAIL] = self._tail
        telemetry.words[Word.LOG_FILE] = log.identity

    def drain(self) -> bool:
        """Write all rows that are there; whether there were any.

        Raises:
            OSError: The log cannot be written; what is not in it stays unread.
        """
        begin, end = self._tail, self._telemetry.words[Word.HEAD]
        while self._tail < end:
            block, _ = self._telemetry.read(self._tail, BLOCK)
            self._log.append(block)
            self._count(block)
        return self._tail > begin

    def _count(self, block: NDArray[np.void]) -> None:
        """Tell that a block is in the log, and how many rows before it never will be."""
        if block.size == 0:
            return
        words = self._telemetry.words
        words[Word.LACKING] += int(block["seq"][0]) - words[Word.TAIL]
        words[Word.TAIL] = self._tail = int(block["seq"][-1]) + 1

    def sync(self) -> None:
        """Have the disk keep what was written; waits for it, while rows wait in the ring.

        Raises:
            OSError: As ``LogWriter.sync``.
        """
        self._log.sync()

    def close(self) -> None:
        """Close the log.

        Raises:
            OSError: The file system has lost something written earlier.
        """
        self._log.close()


class _Attempts:
    """Writes whenever it can; says on standard output when it cannot, and when it can again.

    Rows that could not be written wait, and trouble ends. What is lost after it was written does
    not come back: that is said apart, for whoever listens to remember.
    """

    def __init__(self, telemetry: Telemetry, orders: Mapping[str, Any]) -> None:
        self._telemetry = telemetry
        self._orders = orders
        self._recorder: Recorder | None = None
        self._trouble: str | None = None
        self._synced_s = 0.0

    def write(self) -> bool:
        """Write what is there; whether anything was written."""
        wrote = False
        try:
            if self._recorder is None:
                if not self._telemetry.words[Word.HEAD]:
                    return False  # a run that cannot start touches no file
                self._recorder = Recorder(self._telemetry, self._open())
            wrote = self._recorder.drain()
        except OSError as error:
            self._trouble_is(self._text(error))
            return wrote
        self._trouble_is(None)
        if time.monotonic() - self._synced_s >= SYNC_S:
            self._keep(self._recorder.sync)
            self._synced_s = time.monotonic()
        return wrote

    def close(self) -> None:
        """Close the log, if it was ever open."""
        if self._recorder is not None:
            self._keep(self._recorder.sync)
            self._keep(self._recorder.close)

    def _open(self) -> LogWriter:
        """The log of a recorder that is dead, where it is in its place; else a new one."""
        orders = self._orders
        path = Path(orders["log"])
        if orders["resume"] and identity(path) == self._telemetry.words[Word.LOG_FILE]:
            with contextlib.suppress(LogFormatError, FileNotFoundError):
                return LogWriter.resume(path, ROW)
        force, writer = orders.get("force", False), orders.get("parent")
        return begun_log(path, orders["metadata"], force=force, writer=writer)

    def _keep(self, keep: Callable[[], None]) -> None:
        """Have the disk keep what it has taken; say what it has lost."""
        try:
            keep()
        except OSError as error:
            self._say({"lost": self._text(error)})

    def _trouble_is(self, trouble: str | None) -> None:
        if trouble != self._trouble:
            self._trouble = trouble
            self._say({"trouble": trouble})

    def _text(self, error: OSError) -> str:
        return f"{self._orders['log']}: {error.strerror or error}"

    def _say(self, what: dict[str, str | None]) -> None:
        with contextlib.suppress(BrokenPipeError):  # the supervisor is gone
            os.write(sys.stdout.fileno(), (json.dumps(what) + "\n").encode())


def may_stand_back(words: memoryview[int]) -> bool:
    """Whether a recorder that begins now may leave the processor to everybody else.

    One that takes over what another did not get to write must not starve in its turn: on a busy
    machine such a process may not run for seconds. What stands back once cannot come forward again
    without rights that few have.

    Args:
        words: The control words.
    """
    return not words[Word.FINISHED] and words[Word.HEAD] - words[Word.TAIL] <= BEHIND


def main() -> None:
    """Record until the supervisor says that no more rows will come."""
    orders = read_orders()
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # it ends when the run does, not before
    telemetry = Telemetry(orders["telemetry"])
    if may_stand_back(telemetry.words):
        stand_back()
    orphaned = False

    def be_orphaned(_signal: int, _frame: object) -> None:
        nonlocal orphaned
        orphaned = True

    signal.signal(signal.SIGUSR1, be_orphaned)
    die_with_parent(orders["parent"], signal.SIGUSR1)
    attempts = _Attempts(telemetry, orders)
    while True:
        finished = telemetry.words[Word.FINISHED]  # looked at first: no row comes after it
        wrote = attempts.write()
        # Without a supervisor the loop is about to stop: until no more rows come.
        if finished or (orphaned and not wrote):
            break
        pause_until_lull(telemetry.words, orders["period_ns"], PAUSE_S)
    attempts.close()


if __name__ == "__main__":
    main()
