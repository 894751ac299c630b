"""A log keeps what was written, whatever becomes of the disk, the writer or a reader."""

import math
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.errors import LogFormatError
from haptic_wall.controller.logs.columns import COLUMNS
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.writer import LogWriter, append_end
from haptic_wall.controller.runtime.telemetry import FLOAT_FIELDS, ROW

METADATA = {"name": "simulated", "config": {"wall": {"stiffness": 8.0}}, "unit": "N·m"}
DAY_NS = 86_400_000_000_000


def rows(count: int, start: int = 0) -> NDArray[np.void]:
    block = np.zeros(count, ROW)
    block["seq"] = number = np.arange(start, start + count)
    block["deadline_ns"] = 5 * 10**9 + 1_000_001 * number
    block["position"] = 0.1 * number
    return block


def write(path: Path, *blocks: NDArray[np.void]) -> Path:
    with LogWriter(path, METADATA) as log:
        for block in blocks:
            log.append(block[:, None])
    return path


def test_what_was_written_is_read_to_the_last_bit(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    made = rows(7)
    made["deadline_ns"] += DAY_NS * made["seq"] // 7
    made["sampled_ns"] = made["deadline_ns"] + random.integers(-(10**6), 10**6, 7)
    made["sampled_ns"][0] = 0
    for name in ("lateness_ns", "work_ns", "bus_ns", "age_ns"):
        made[name] = random.integers(-5, 10**9, 7)
    for name in FLOAT_FIELDS:
        made[name] = random.normal(size=7)
    made["position"][0] = made["measured_torque"][:] = math.nan
    log = LogReader.open(write(tmp_path / "a.hwlog", made[:3], made[:0], made[3:]))
    assert {**METADATA, **log.metadata} == log.metadata
    assert log.rows().tobytes() == made.tobytes()
    late = LogReader.open(log.path, (float(made["deadline_ns"][4] - 5 * 10**9) / 1e9, math.inf))
    assert late.rows().tobytes() == made[4:].tobytes()


def test_others_read_it_without_this_program(tmp_path: Path) -> None:
    path = write(tmp_path / "a.hwlog", rows(3))
    append_end(path, {"stop_reason": "duration"}, [{"at_s": 0.5, "set": [], "outcome": "refused"}])
    assert [each.name for each in tmp_path.iterdir()] == ["a.hwlog"], "it is one file"
    db = sqlite3.connect(path)
    found = db.execute("SELECT * FROM rows")
    assert [name for name, *_ in found.description] == [*COLUMNS]
    assert [row[:2] for row in found] == [(0.0, 0.0), (0.001000001, 0.1), (0.002000002, 0.2)]
    (report,) = db.execute("SELECT json_extract(value, '$.stop_reason') FROM meta NATURAL JOIN"
                           " (SELECT 'report' AS key)").fetchone()  # fmt: skip
    assert report == "duration"
    assert db.execute("SELECT time_s, text ->> 'outcome' FROM events").fetchall() == [
        (0.5, "refused")
    ]
    db.close()


def test_a_file_is_replaced_only_when_it_is_said(tmp_path: Path) -> None:
    path = write(tmp_path / "a.hwlog", rows(3))
    with pytest.raises(FileExistsError):
        LogWriter(path, METADATA)
    assert len(LogReader.open(path).rows()) == 3
    for end, magic in (("-wal", "377f0682"), ("-journal", "d9d505f920a163d7"), ("-shm", "")):
        (tmp_path / f"a.hwlog{end}").write_bytes(bytes.fromhex(magic))  # of an earlier log
    with LogWriter(path, METADATA, force=True) as log:
        log.append(rows(2)[:, None])
    assert len(LogReader.open(path).rows()) == 2
    with pytest.raises(OSError, match="No such file"):
        LogWriter(tmp_path / "nowhere" / "a.hwlog", METADATA)


def test_a_full_disk_costs_only_what_did_not_fit(tmp_path: Path) -> None:
    path = tmp_path / "a.hwlog"
    with LogWriter(path, METADATA) as log:
        log.append(rows(10)[:, None])
        (pages,) = log._db.execute("PRAGMA page_count").fetchone()
        log._db.execute(f"PRAGMA max_page_count={pages + 1}").fetchall()
        for _ in range(2):
            with pytest.raises(OSError, match="No space left"):
                log.append(rows(300, 10)[:, None])
            np.testing.assert_array_equal(LogReader.open(path).rows(), rows(10))
        log._db.execute("PRAGMA max_page_count=10000").fetchall()
        log.append(rows(300, 10)[:, None])
    np.testing.assert_array_equal(LogReader.open(path).rows(), rows(310))


def test_a_reader_that_stays_costs_no_row_and_sees_its_own_time(tmp_path: Path) -> None:
    path = tmp_path / "a.hwlog"
    with LogWriter(path, METADATA) as log:
        log.append(rows(10)[:, None])
        reader = sqlite3.connect(path, isolation_level=None)
        reader.execute("BEGIN")
        assert reader.execute("SELECT count(*) FROM rows").fetchone() == (10,)
        log.append(rows(90, 10)[:, None])
        log.sync()
        assert len(LogReader.open(path).rows()) == 100
        assert reader.execute("SELECT count(*) FROM rows").fetchone() == (10,)
    reader.close()
    append_end(path, {"stop_reason": "duration"})
    assert len(LogReader.open(path).rows()) == 100
    assert [each.name for each in tmp_path.iterdir()] == ["a.hwlog"]


KILLED = """
import os, signal, sys
from pathlib import Path
from haptic_wall.controller.logs.writer import LogWriter
from tests.controller.logs.test_file import METADATA, rows
log = LogWriter(Path(sys.argv[1]), METADATA)
for k in range(40):
    log.append(rows(25, 25 * k)[:, None])
    if k % 3 == 2:
        log.sync()
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_another_writer_goes_on_where_one_was_killed(tmp_path: Path) -> None:
    path = tmp_path / "a.hwlog"
    root = Path(__file__).parents[3]
    killed = subprocess.run([sys.executable, "-c", KILLED, path], cwd=root, check=False)
    assert killed.returncode == -signal.SIGKILL
    np.testing.assert_array_equal(LogReader.open(path).rows(), rows(1000))
    with LogWriter(path, {}, resume=True) as log:
        assert log.seqs_from(990).tolist() == [*range(990, 1000)]
        log.append(rows(5, 1000)[:, None])
    np.testing.assert_array_equal(LogReader.open(path).rows(), rows(1005))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is not a log of haptic-wall"),
        (b"time_s,position_rad\n0,0\n", "is not a log of haptic-wall"),
        (b"\x93NUMPY\x01\x00v\x00{'descr'", "is a log of a version before 0.2"),
        (b"SQLite format 3\x00" + bytes(84), "is not a log of haptic-wall"),
        (b"SQLite format 3\x00" + bytes(44) + b"\0\0\0\x09" + bytes(4) + b"hwlg", "version 9"),
    ],
)
def test_another_file_is_not_a_log(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "other.hwlog"
    path.write_bytes(content)
    with pytest.raises(LogFormatError, match=said):
        LogReader.open(path)
    with pytest.raises(LogFormatError, match=said):
        LogWriter(path, {}, resume=True)
    assert path.read_bytes() == content
