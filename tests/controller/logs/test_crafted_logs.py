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
from haptic_wall.controller.errors import LogFormatError, UserError
from haptic_wall.controller.logs.blocks import MAGIC, encoded
from haptic_wall.controller.logs.file import append_end, read_log
from haptic_wall.controller.logs.reader import FORMAT, LogReader, Misplaced
from haptic_wall.controller.logs.recordings import read_recordings
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


def orders(*blocks: int) -> list[NDArray[np.void]]:
    return [rows(50 * k, 50 * k + 50) for k in blocks]


@pytest.mark.parametrize(
    ("blocks", "read", "late", "twice", "missing"),
    [
        ((0, 1, 2, 3), (0, 1, 2, 3), 0, 0, 0),
        ((0, 1, 1, 2, 3), (0, 1, 2, 3), 0, 50, 0),
        ((0, 1, 2, 0, 1, 3), (0, 1, 2, 3), 0, 100, 0),
        ((0, 2, 1, 3), (0, 2, 3), 50, 0, 0),
        ((3, 2, 1, 0), (3,), 150, 0, 0),
        ((0, 3, 1), (0, 3), 50, 0, 50),
    ],
)
def test_blocks_out_of_order_or_twice_are_told(
    log: Path,
    capsys: pytest.CaptureFixture[str],
    blocks: tuple[int, ...],
    read: tuple[int, ...],
    late: int,
    twice: int,
    missing: int,
) -> None:
    """A summary counted -1687 s, and detect ended with a traceback."""
    log_of(log, *orders(*blocks))
    found = summary(capsys, log)
    assert found["rows"] == 50 * len(read)
    assert found["misplaced_rows"] == {"late": late, "twice": twice}
    assert found["unrecorded_rows"] == missing
    assert found["duration_s"] == pytest.approx(0.05 * (read[-1] - read[0] + 1) - 0.001)
    np.testing.assert_array_equal(read_log(log)[1]["seq"], np.concatenate(orders(*read))["seq"])
    detected = json.loads(told(capsys, "detect", log, "--json")[1])
    assert detected["samples"] == found["rows"], "log and detect agree"
    text = told(capsys, "log", log)[1]
    assert (f"{late} rows come after later ones: they are left out" in text) == bool(late)
    assert (f"{twice} rows occur twice: they are read once" in text) == bool(twice)
    said = " ".join(detected["notes"])
    assert ("come after later ones" in said, "occur twice" in said) == (
        bool(late),
        bool(twice),
    )


def test_a_block_that_is_new_in_part_gives_that_part(log: Path) -> None:
    log_of(log, rows(0, 50), rows(30, 80))
    first, old, new = LogReader(log).pieces()
    assert isinstance(first, np.ndarray) and isinstance(new, np.ndarray)
    assert (len(first), old, new["seq"].tolist()) == (50, Misplaced(20, 20), list(range(50, 80)))


# Two logs in one file


@pytest.fixture
def joined(log: Path) -> Path:
    config = load_config("simulated", ["wall.side=both"]).config
    other = {**METADATA, "name": "other", "config": config.model_dump(mode="json")}
    log_of(log, rows(0, 200), {"stop_reason": "duration", "rows": 200})
    first = log.read_bytes()
    log_of(log, rows(0, 100), rows(100, 300), metadata=other)
    append_end(log, {"stop_reason": "trip:overspeed", "message": "fast", "rows": 301})
    log.write_bytes(first + log.read_bytes())
    return log


def test_two_logs_in_one_file_are_two_parts(
    joined: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = summary(capsys, joined)
    assert (found["rows"], found["unrecorded_rows"]) == (500, 1)
    assert found["duration_s"] == pytest.approx(0.199 + 0.299)
    assert found["rate_hz"] == pytest.approx(1000.0)
    first, second = found["parts"]
    assert (first["name"], first["rows"], first["stop_reason"]) == ("simulated", 200, "duration")
    assert (second["name"], second["rows"]) == ("other", 300)
    assert (second["from_s"], second["to_s"]) == pytest.approx((1.199, 1.498))
    text = told(capsys, "log", joined)[1]
    assert "joined      2 logs in one file" in text
    assert "other (haptic-wall 0.1.0): 300 rows from 1.199 to 1.498 s; ended BY A SAFETY" in text
    detected = json.loads(told(capsys, "detect", joined, "--json")[1])
    assert (detected["samples"], detected["parts"]) == (500, 2)
    assert "part 2 is another log, other, joined to the one before" in detected["notes"]
    assert [each.known.side for each in read_recordings(joined)] == [1, 0]
    with pytest.raises(LogFormatError, match="another log is joined to it"):
        read_log(joined)


def test_of_joined_logs_one_is_cut(
    joined: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = tmp_path / "cut.hwlog"
    status, text = told(capsys, "log", joined, "--from", 0.1, "--cut", cut)
    assert status == 2
    assert "choose one of them by --from and --to: 0.1 to 0.199 s, 1.199 to 1.498 s" in text
    assert summary(capsys, joined, "--from", 1.3, "--cut", cut)["name"] == "other"
    assert read_log(cut)[1]["seq"].tolist() == list(range(101, 300))


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
    "text", [b'{"rows": 1e400}', b'{"rows": NaN}', b"[" * 9000, b'{"a": ' * 99]
)
def test_what_is_no_json_is_damage(
    log: Path, capsys: pytest.CaptureFixture[str], text: bytes
) -> None:
    log_of(log, rows(0, 50), np.frombuffer(text, np.uint8))
    assert summary(capsys, log)["damaged"]["places"] == 1


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


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_of_a_loop_that_went_wrong_are_read(
    log: Path, capsys: pytest.CaptureFixture[str], value: float
) -> None:
    log_of(log, rows(0, 50), rows(50, 100, position=value, torque=value, velocity=value))
    found = summary(capsys, log)
    assert (found["rows"], found["damaged"]["places"]) == (100, 0)
    assert told(capsys, "detect", log)[0] == 0


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


@pytest.mark.parametrize(
    "piece",
    [MAGIC, MAGIC + b"\x10\x00{'descr': ", bytes(encoded(np.zeros(2**20, np.uint8))[0])],
    ids=["magic", "begin", "head"],
)
def test_what_only_looks_like_blocks_is_passed_over(
    log: Path, capsys: pytest.CaptureFixture[str], piece: bytes
) -> None:
    """20 MB of magic behind an intact block took more than 100 s."""
    log_of(log, rows(0, 50))
    with log.open("ab") as file:
        file.write(piece * (20_000_000 // len(piece)))
    found = summary(capsys, log)
    assert (found["rows"], found["damaged"]["cut_off"]) == (50, True)


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


def test_a_log_is_known_whatever_its_name(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its bytes went to the terminal: found no column time_s, but these."""
    log_of(log, rows(0, 50))
    other = tmp_path / "run.csv"
    content = log.read_bytes()
    for damaged in (content, b"\x00" * 100 + content[100:]):
        other.write_bytes(damaged)
        status, text = told(capsys, "detect", other, "--json")
        if damaged is content:
            assert (status, json.loads(text)["samples"]) == (0, 50)
        else:
            assert (status, "has no configuration" in text) == (2, True)
    with pytest.raises(UserError, match="is not a log of haptic-wall"):
        other.rename(log)
        log.write_text("time_s,position_rad\n")
        list(read_recordings(log))
