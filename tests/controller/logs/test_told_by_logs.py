"""A log with any configuration, events and end is shown, or refused in one sentence."""

import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

import pytest

from haptic_wall.controller.live.server import LiveServer
from haptic_wall.controller.logs.writer import LogWriter, append_end
from tests.support.told_logs import called, one_turn, rows, story

pytestmark = pytest.mark.usefixtures("undrawn")


def written(path: Path, told: dict[str, Any]) -> Path:
    """Write a log as a run does; what is no JSON is left out."""
    made = rows(300)
    with LogWriter(path, told["metadata"], force=True) as log:
        log.append(made)
        for event in told["events"]:
            if isinstance(event, dict):
                with suppress(sqlite3.Error, OSError, OverflowError, UnicodeEncodeError):
                    log.event(event)
    append_end(path, told["end"])
    return path


def faults(path: Path, number: int) -> Iterator[str]:
    """What commands do with a log that they may not do."""
    picture = path.with_suffix(".png")
    commands = [["log"], ["log", "--json"], ["detect"], ["live"]]
    if number % 10 == 0:  # drawing takes longer than all the rest
        commands.append(["log", "--plot", str(picture), "--force"])
    for name, *options in commands:
        answer = called(name, path, *options)
        if answer.fault:
            yield f"{number} {name}: {answer.fault}"
        elif answer.status and answer.err.count("\n") != 1:
            yield f"{number} {name}: not one sentence: {answer.err}"


@pytest.mark.whole
def test_whatever_a_log_tells_has_a_result_or_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, thorough: bool, wholly: bool
) -> None:
    monkeypatch.setattr(LiveServer, "run", one_turn)
    found: list[str] = []
    for number in range(5000 if thorough else 100 if wholly else 40):
        told = story(Random(f"story {number}"))
        found += faults(written(tmp_path / "a.hwlog", told), number)
    assert found == []
