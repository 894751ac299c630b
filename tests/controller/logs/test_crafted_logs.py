"""Right checksums say that a block is what was written, not that a run wrote it."""

import json
import os
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.cli.main import main
from haptic_wall.controller.logs.blocks import encoded
from haptic_wall.controller.logs.reader import FORMAT
from haptic_wall.controller.runtime.telemetry import ROW
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.system.printable import printable
from tests.typed import not_none

CONFIG = load_config("simulated").config.model_dump(mode="json")
METADATA = {**FORMAT, "program": "haptic-wall 0.1.0", "name": "simulated", "config": CONFIG}


def rows(start: int, end: int, **columns: object) -> NDArray[np.void]:
    made = np.zeros(end - start, ROW)
    made["seq"] = np.arange(start, end)
    made["deadline_ns"] = 5_000_000_000 + 1_000_000 * made["seq"]
    made["position"] = 0.01 * np.sin(0.03 * made["seq"])
    made["torque"] = -made["position"]
    for name, values in columns.items():
        made[name] = values
    return made


def block(content: Mapping[str, Any] | NDArray[np.void]) -> bytes:
    if not isinstance(content, np.ndarray):
        content = np.frombuffer(json.dumps(content).encode(), np.uint8)
    head, data = encoded(content)
    return head + bytes(data)


def log_of(
    path: Path,
    *contents: Mapping[str, Any] | NDArray[np.void],
    metadata: Mapping[str, Any] = METADATA,
) -> Path:
    path.write_bytes(b"".join(map(block, (metadata, *contents))))
    return path


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "a.hwlog"


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    """What a command says, and its exit status; never a traceback, or what a terminal obeys."""
    status = main(list(map(str, arguments)))
    captured = capsys.readouterr()
    assert captured.out + captured.err == printable(captured.out + captured.err)
    return status, captured.out + captured.err


def summary(capsys: pytest.CaptureFixture[str], path: Path, *arguments: Any) -> dict[str, Any]:
    status, text = told(capsys, "log", path, "--json", *arguments)
    assert status == 0, text
    summed: dict[str, Any] = json.loads(text)
    return summed


# In order, once each


# Two logs in one file


# What no run writes


@pytest.mark.parametrize(
    ("ended", "why"),
    [
        ({"rows": -1}, "rows is no count in it"),
        ({"rows": 10**300}, "rows is no count in it"),
        ({"stop_reason": 5}, "stop_reason is no text in it"),
        ({"message": {}}, "message is no text in it"),
        ({"guard": {"reasons": [{}]}}, "guard has no list of texts as its reasons"),
        ({"warnings": "text"}, "warnings is no list of texts in it"),
    ],
)
def test_an_end_that_no_run_writes_is_told_as_damage(
    log: Path, capsys: pytest.CaptureFixture[str], ended: dict[str, Any], why: str
) -> None:
    log_of(log, rows(0, 50), ended)
    found = summary(capsys, log)
    assert found["rows"] == 50
    assert found["stop_reason"] is None
    assert found["damaged"]["why"] == f"the run's end: {why}"


@pytest.mark.parametrize(
    ("column", "value", "why"),
    [
        ("oscillation", 99, "oscillation is 99 in it, wanted 0 to 3"),
        ("deadline_ns", 2**63 - 1, "deadline_ns is 9223372036854775807 in it"),
        ("deadline_ns", 5, "deadline_ns does not increase in it"),
        ("seq", 7, "seq does not increase in it"),
        ("lateness_ns", 2**62, "lateness_ns is"),
        ("torque", 1e300, "torque is 1e+300 in it, which is too large"),
    ],
)
def test_a_block_of_rows_that_no_loop_writes_is_told_as_damage(
    log: Path, capsys: pytest.CaptureFixture[str], column: str, value: float, why: str
) -> None:
    log_of(log, rows(0, 50), rows(50, 100, **{column: value}), rows(100, 150))
    found = summary(capsys, log)
    assert (found["rows"], found["damaged"]["rows"]) == (100, 50)
    assert why in found["damaged"]["why"]
    assert f"of the first: {why}" in told(capsys, "log", log)[1]
    status, text = told(capsys, "detect", log, "--json")
    assert (status, json.loads(text)["samples"]) == (0, 100)
    assert any(why in note for note in json.loads(text)["notes"])


# Bounds


NARROW = np.dtype(
    [(name, "<f4" if name == "position" else ROW[name]) for name in not_none(ROW.names)]
)
OTHER = np.dtype([*((name, ROW[name]) for name in not_none(ROW.names)), ("\x1b[31m", "<f8")])


@pytest.mark.parametrize(
    ("dtype", "said"),
    [
        (NARROW, "its column position is of type 'float32', wanted '<f8'"),
        (OTHER, r"its rows have a column '\x1b[31m' that this program does not know"),
        (np.dtype([("seq", "<i8"), ("position", "<f8")]), "its rows lack the column deadline_ns"),
    ],
)
def test_rows_of_other_columns_are_refused_in_a_sentence(
    log: Path, capsys: pytest.CaptureFixture[str], dtype: np.dtype[np.void], said: str
) -> None:
    made = np.zeros(20, dtype)
    made["seq"] = np.arange(20)
    log_of(log, made)
    for command in ("log", "detect"):
        status, text = told(capsys, command, log)
        assert (status, text.count("\n")) == (2, 1)
        assert said in text or command == "detect"


@pytest.mark.parametrize("command", ["log", "detect"])
@pytest.mark.parametrize("kind", ["pipe", "socket", "device", "folder"])
def test_what_may_never_end_is_refused_at_once(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: str,
    kind: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    with socket.socket(socket.AF_UNIX) as listening:
        if kind == "pipe":
            os.mkfifo("a.hwlog")
        elif kind == "socket":
            listening.bind("a.hwlog")
        elif kind == "device":
            Path("a.hwlog").symlink_to("/dev/zero")
        else:
            (tmp_path / "a.hwlog").mkdir()
        status, text = told(capsys, command, "a.hwlog")
    assert status == 2
    assert f"it is a {kind}, not a file" in text or "Is a directory" in text


# By content, not by name
