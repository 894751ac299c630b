"""A run in one process says how many rows its log lacks, and what the disk told last."""

import errno
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.writer import LogWriter
from haptic_wall.controller.processes.inline import run_inline
from haptic_wall.controller.processes.plan import Ended, Plan
from haptic_wall.controller.processes.run import told_later
from haptic_wall.controller.runtime.telemetry import Telemetry, Word
from haptic_wall.controller.settings.load import load_config


@pytest.fixture
def ended(tmp_path: Path) -> Callable[..., tuple[Ended, int]]:
    """Runs six seconds, and returns how it ended and how many rows there were."""

    def run(log: Path = tmp_path / "run.hwlog") -> tuple[Ended, int]:
        telemetry = Telemetry.create()
        config = load_config("simulated", ["loop.clock=simulated"]).config
        return run_inline(Plan(config, 6.0, log, {}, None), telemetry), telemetry.words[Word.HEAD]

    return run


def test_a_full_disk_leaves_out_what_it_did_not_take(
    ended: Callable[..., tuple[Ended, int]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    append, blocks = LogWriter.append, []

    def fill(log: LogWriter, rows: NDArray[np.void]) -> None:
        blocks.append(rows)
        if len(blocks) > 3:
            raise OSError(errno.ENOSPC, "No space left on device")
        append(log, rows)

    monkeypatch.setattr(LogWriter, "append", fill)
    cut, rows = ended()
    assert cut.lacking == rows - len(LogReader.open(tmp_path / "run.hwlog").rows()) > 0
    (warning,) = cut.warnings
    assert f"{tmp_path / 'run.hwlog'} is incomplete: No space left on device" in warning


def test_a_terminal_that_blocks_or_is_gone_holds_no_message_back() -> None:
    read, heard = threading.Event(), list[str]()

    def tell(text: str) -> None:
        assert read.wait(60.0)
        heard.append(text)
        raise BrokenPipeError

    with told_later(tell) as told:
        told("one")
        told("two")
        assert not heard
        read.set()
    assert heard == ["one", "two"]
