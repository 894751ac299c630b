"""Whatever becomes of a recorder, another goes on: each row is in the log once, and it is told."""

import errno
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.writer import identity
from haptic_wall.controller.processes import children, recorder_monitor
from haptic_wall.controller.processes.recorder import Recorder
from haptic_wall.controller.processes.recorder_monitor import RecorderMonitor
from haptic_wall.controller.runtime.telemetry import CAPACITY, Telemetry, Word
from tests.support.rows import next_row


class Child:
    """A recorder without a process: it writes when it is let, and ends as it is told."""

    def __init__(self, telemetry: Telemetry, path: Path) -> None:
        self._recorder = Recorder(telemetry, path, {}, ("",))
        self._words = telemetry.words
        self._said: list[dict[str, object]] = []
        self.writes = True
        self.code: int | None = None

    def turn(self) -> None:
        if self.code is None and self.writes:
            self._recorder.drain()
            if self._words[Word.FINISHED]:
                self.end(0)

    def say(self, trouble: str | None, *, full: bool = True) -> None:
        self._said.append({"trouble": trouble, "full": full})

    def end(self, code: int) -> None:
        if self.code is None:
            self.code = code
            self._recorder.log.close()

    def said(self) -> list[dict[str, object]]:
        said, self._said = self._said, []
        return said

    def ended(self) -> bool:
        return self.code is not None

    def well(self) -> bool:
        return self.code == 0

    def exit_text(self) -> str:
        return {None: "is running", 0: "ended with 0"}.get(self.code, "was killed by SIGKILL")

    def wait(self, timeout_s: float) -> bool:
        if timeout_s > 0.0:
            self.turn()
        return self.ended()

    def dismiss(self, _timeout_s: float) -> None:
        self.end(-9)


class Run:
    """A loop that writes a row each millisecond, a monitor that looks, on one simulated time."""

    def __init__(self, folder: Path, child: Callable[..., Child] = Child) -> None:
        self._child = child
        self.telemetry = Telemetry.create()
        self.words = self.telemetry.words
        self.path = folder / "run.hwlog"
        self.told: list[str] = []
        self.recorders: list[Child] = []
        self.refused: OSError | None = None
        self.now = 0.0
        start = cast(Callable[[], children.Child], self.start)
        self.monitor = RecorderMonitor(start, self.words, self.told.append, self.now)

    def start(self) -> Child:
        if self.refused is not None:
            raise self.refused
        self.recorders.append(self._child(self.telemetry, self.path))
        return self.recorders[-1]

    def go(self, seconds: float, rows_per_s: int = 1000, step: float = 0.25) -> None:
        for _ in range(round(seconds / step)):
            self.now += step
            for _ in range(round(rows_per_s * step)):
                self.telemetry.write(*next_row())
            self.recorders[-1].turn()
            self.monitor.look(self.now)

    def end(self) -> tuple[list[str], NDArray[np.int64]]:
        """The notes, and the rows that the log holds."""
        notes = self.monitor.end()
        self.monitor.close()
        return notes, LogReader.open(self.path).rows()["seq"]


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Run]:
    run = Run(tmp_path)
    yield run
    run.recorders[-1].end(-9)


def test_a_killed_recorder_is_told_at_once_and_no_row_is_lost(run: Run) -> None:
    run.go(2.0)
    run.recorders[-1].end(-9)
    run.go(0.25)
    assert run.told == [
        "the recorder was killed by SIGKILL; another one continues the log",
    ]
    assert len(run.recorders) == 2
    run.go(2.0)
    notes, rows = run.end()
    assert notes == [
        "the recorder was killed by SIGKILL; another one continued, and no row is missing from the"
        " log"
    ]
    np.testing.assert_array_equal(rows, np.arange(4250))


def test_a_recorder_killed_before_it_could_tell_of_its_last_block_loses_nothing(run: Run) -> None:
    run.go(2.0)
    told = run.words[Word.TAIL]
    run.telemetry.write(*next_row())
    run.recorders[-1].turn()
    run.words[Word.TAIL] = told  # the block is in the log, but nobody knows
    run.recorders[-1].end(-9)
    (note,), rows = run.end()
    assert "no row is missing" in note
    np.testing.assert_array_equal(rows, np.arange(2001))


def test_a_recorder_killed_before_its_log_was_one_is_followed_by_another(run: Run) -> None:
    run.recorders[-1].end(-9)
    run.path.write_bytes(b"half a log")
    run.words[Word.LOG_FILE] = identity(run.path)
    run.go(2.0)
    assert len(run.recorders) == 2
    _, rows = run.end()
    np.testing.assert_array_equal(rows, np.arange(2000))


def test_a_full_disk_is_told_at_once_and_only_what_memory_cannot_hold_is_lost(run: Run) -> None:
    run.go(2.0)
    run.recorders[-1].writes = False
    run.recorders[-1].say("run.hwlog: No space left on device")
    run.go(1.0, rows_per_s=CAPACITY // 2 + 8)
    run.go(20.0, rows_per_s=4)
    assert len(run.recorders) == 1, "one that waits for room is left alone"
    (told,) = run.told
    assert "the log cannot be written (run.hwlog: No space left on device); make room" in told
    run.go(1.0, rows_per_s=CAPACITY // 2)
    assert "the log loses rows" in run.told[1]
    run.recorders[-1].writes = True
    run.recorders[-1].say(None)
    run.go(1.0)
    assert run.told[2:] == ["the log is written again"]
    (note,), rows = run.end()
    missing = run.words[Word.HEAD] - len(rows)
    assert missing > 0
    assert f"lacks {missing} of {run.words[Word.HEAD]} rows" in note
    assert run.monitor.lacking == missing
    assert np.all(np.diff(rows) > 0)


@pytest.mark.parametrize("how", ["killed", "stopped"])
def test_the_last_rows_are_written_by_another_recorder(run: Run, how: str) -> None:
    run.go(2.0)
    if how == "killed":
        run.recorders[-1].end(-9)
    else:
        run.recorders[-1].writes = False
    run.telemetry.write(*next_row())
    notes, rows = run.end()
    assert len(run.recorders) == 2
    assert "no row is missing" in notes[0]
    np.testing.assert_array_equal(rows, np.arange(2001))


def test_where_no_recorder_can_write_the_end_it_is_said_how_much_is_missing(run: Run) -> None:
    run.go(2.0)
    run.recorders[-1].end(-9)
    run.telemetry.write(*next_row())
    run.refused = OSError(errno.EAGAIN, "Resource temporarily unavailable")
    notes, rows = run.end()
    assert any("lacks 1 of 2001 rows" in note for note in notes)
    assert run.monitor.lacking == 1
    assert len(rows) == 2000
    assert len(run.recorders) == 1 <= recorder_monitor.LAST_ATTEMPTS
