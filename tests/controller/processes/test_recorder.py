"""A recorder that is shot at: a full disk, a kill, a dead supervisor; each row is recorded once."""

import itertools
import os
import resource
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from haptic_wall.controller.logs.file import read_log
from haptic_wall.controller.processes.children import Child
from haptic_wall.controller.processes.plan import Plan
from haptic_wall.controller.processes.recorder_monitor import RecorderMonitor
from haptic_wall.controller.processes.run import run
from haptic_wall.controller.runtime.telemetry import Row, Telemetry, Word
from haptic_wall.controller.settings.load import load_config
from tests.typed import not_none

TICKS = itertools.count()


def row() -> Row:
    """A row of the next period."""
    return Row(deadline_ns=next(TICKS) * 1_000_000)


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

    def start(self, resume: bool) -> Child:
        orders = {
            "telemetry": self.telemetry.descriptor,
            "parent": os.getpid(),
            "log": str(self.path),
            "metadata": {"name": "simulated"},
            "period_ns": 1_000_000,
            "resume": resume,
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
                self.telemetry.write(row())
            self.monitor.look(time.monotonic())
            time.sleep(0.01)

    def recorded(self) -> int:
        return self.telemetry.words[Word.TAIL]


def test_rows_survive_a_full_disk_and_a_kill_in_the_midst_of_it(tmp_path: Path) -> None:
    recording = Recording(tmp_path / "run.hwlog")
    recording.until(lambda: recording.recorded() > 0)
    room = recording.path.stat().st_size + 50  # the next block fits in part only
    resource.prlimit(recording.recorders[0].pid, resource.RLIMIT_FSIZE, (room, -1))
    recording.until(lambda: recording.told)
    assert "run.hwlog: File too large" in recording.told[0]
    before = recording.recorded()
    recording.recorders[0].send(signal.SIGKILL)
    recording.until(lambda: recording.recorded() > before)
    assert "was killed by SIGKILL; another one continues" in recording.told[1]
    recording.telemetry.write(row())
    (note,) = recording.monitor.end()
    recording.monitor.close()
    assert "no row is missing" in note
    np.testing.assert_array_equal(
        read_log(recording.path)[1]["seq"], np.arange(recording.telemetry.words[Word.HEAD])
    )


def test_a_recorder_whose_supervisor_is_dead_writes_what_comes_and_ends(tmp_path: Path) -> None:
    recording = Recording(tmp_path / "run.hwlog")
    (recorder,) = recording.recorders
    recording.until(lambda: recording.recorded() > 0)
    for _ in range(100):
        recording.telemetry.write(row())
    recorder.send(signal.SIGUSR1)  # as the kernel does
    assert recorder.wait(10.0)
    assert recorder.well()
    assert len(read_log(recording.path)[1]) == recording.telemetry.words[Word.HEAD]
    recording.monitor.close()


def test_a_log_that_can_never_be_written_is_told_and_holds_nothing_up(tmp_path: Path) -> None:
    (tmp_path / "run.hwlog").symlink_to("/dev/full")
    recording = Recording(tmp_path / "run.hwlog")
    recording.until(lambda: recording.told)
    notes = recording.monitor.end()
    recording.monitor.close()
    assert "No space left on device" in notes[0]
    assert f"lacks {recording.telemetry.words[Word.HEAD]} of" in notes[0]


def test_a_supervised_run_says_how_many_rows_its_log_lacks(tmp_path: Path) -> None:
    (tmp_path / "run.hwlog").symlink_to("/dev/full")
    config = load_config("simulated", ["loop.clock=monotonic"]).config
    told: list[str] = []
    ended = run(Plan(config, 0.3, tmp_path / "run.hwlog", {}, None), told.append)
    (note,) = (warning for warning in ended.warnings if "it lacks" in warning)
    assert not_none(ended.lacking) > 0
    assert f"it lacks {ended.lacking} of {ended.lacking} rows" in note
