"""A recorder that is shot at: a full disk, a kill, a dead supervisor; each row is recorded once."""

import itertools
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.writer import identity
from haptic_wall.controller.processes.children import Child
from haptic_wall.controller.processes.recorder_monitor import RecorderMonitor
from haptic_wall.controller.runtime.telemetry import Telemetry, Word
from tests.support.rows import row

TICKS = itertools.count()


def next_row() -> list[float]:
    """A row of the next period."""
    return row(deadline_ns=next(TICKS) * 1_000_000)


pytestmark = pytest.mark.realtime


class Recording:
    """A ring that is written here, recorded by real processes."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.telemetry = Telemetry.create()
        self.told: list[str] = []
        self.recorders: list[Child] = []
        self.monitor = RecorderMonitor(
            self.start, self.telemetry.words, self.told.append, time.monotonic()
        )

    def start(self) -> Child:
        orders = {
            "telemetry": self.telemetry.descriptor,
            "axes": [""],
            "parent": os.getpid(),
            "log": str(self.path),
            "metadata": {"name": "simulated"},
            "period_ns": 1_000_000,
        }
        descriptors = [self.telemetry.descriptor]
        self.recorders.append(
            Child("recorder", ["haptic_wall.controller.processes.recorder"], orders, descriptors)
        )
        return self.recorders[-1]

    def until(self, condition: Callable[..., object], rows: int = 7) -> None:
        """Write a few rows again and again until something has happened."""
        end = time.monotonic() + 30.0
        while not condition():
            assert time.monotonic() < end, self.told
            for _ in range(rows):
                self.telemetry.write(*next_row())
            self.monitor.look(time.monotonic())
            time.sleep(0.01)

    def recorded(self) -> int:
        return self.telemetry.words[Word.TAIL]


def test_a_recorder_whose_supervisor_is_dead_writes_what_comes_and_ends(tmp_path: Path) -> None:
    recording = Recording(tmp_path / "run.hwlog")
    (recorder,) = recording.recorders
    recording.until(lambda: recording.recorded() > 0)
    for _ in range(100):
        recording.telemetry.write(*next_row())
    recorder.send(signal.SIGUSR1)  # as the kernel does
    assert recorder.wait(10.0)
    assert recorder.well()
    assert len(LogReader.open(recording.path).rows()) == recording.telemetry.words[Word.HEAD]
    recording.monitor.close()


def test_a_recorder_that_was_killed_before_its_log_was_one_is_followed_by_another(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.hwlog"
    path.write_bytes(b"half a log")
    recording = Recording(path)
    recording.telemetry.words[Word.LOG_FILE] = identity(path)
    recording.recorders[0].send(signal.SIGKILL)
    recording.until(lambda: recording.recorded() > 0)
    recording.telemetry.words[Word.FINISHED] = 1
    assert recording.recorders[-1].wait(10.0)
    assert LogReader.open(path).rows()["seq"][0] == 0
    recording.monitor.close()
