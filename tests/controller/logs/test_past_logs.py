"""A log of each format there ever was, as its own program wrote it, is read like one of today."""

import json
from pathlib import Path

import pytest

from haptic_wall.controller.cli.main import main

PAST = sorted((Path(__file__).parent / "past").glob("*.hwlog"))
"""40 ticks of a simulated wall, begun inside it: before there were phases, checksums, an end; with
losses counted in a row; and of today."""


def answer(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert main(list(map(str, arguments))) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    return captured.out


@pytest.mark.parametrize("log", PAST, ids=lambda log: log.stem)
def test_every_command_reads_it(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    summary = json.loads(answer(capsys, "log", log, "--json"))
    assert (summary["rows"], summary["unrecorded_rows"], summary["phases"]) == (40, 0, 1)
    assert summary["damaged"]["places"] == summary["missed_ticks"] == 0
    assert summary["position_rad"] == pytest.approx([0.0322, 0.0506], abs=1e-4)
    watched = log != PAST[0]
    assert summary["oscillation"]["state"] == ("quiet" if watched else None)
    assert summary["stop_reason"] == (None if log in PAST[:3] else "duration")
    assert f"oscillation {'quiet' if watched else 'not watched'}" in answer(capsys, "log", log)
    csv, mcap = tmp_path / "a.csv", tmp_path / "a.mcap"
    answer(capsys, "log", log, "--csv", csv, "--mcap", mcap)
    assert len(csv.read_text().splitlines()) == 41
    assert mcap.stat().st_size
    assert json.loads(answer(capsys, "detect", log, "--json"))["samples"] == 40
