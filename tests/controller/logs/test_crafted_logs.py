"""A file that no run has written is refused in one sentence, soon and in little memory."""

import os
import resource
import socket
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from random import Random
from typing import Any

import pytest

from haptic_wall.controller.cli.detect import OWN
from haptic_wall.controller.cli.main import main
from haptic_wall.controller.logs.file import ONE_AXIS, schema
from haptic_wall.controller.logs.writer import LogWriter, append_end
from haptic_wall.controller.system.printable import printable
from tests.cases import sampled
from tests.cli.test_text import REPORT
from tests.support.program import Cli
from tests.support.told_logs import EVENTS, metadata, rows


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "a.hwlog"
    with LogWriter(path, metadata()) as writer:
        writer.append(rows(6_000)[:, None])
        writer.event(EVENTS[0])
    append_end(path, REPORT | {"rows": 6_000})
    return path


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    """What a command says, and its exit status; never a traceback, or what a terminal obeys."""
    status = main(list(map(str, arguments)))
    captured = capsys.readouterr()
    assert captured.out + captured.err == printable(captured.out + captured.err)
    return status, captured.out + captured.err


def written(script: str) -> Callable[[sqlite3.Connection], None]:
    """Return what a hostile hand does to the database."""

    def change(db: sqlite3.Connection) -> None:
        db.executescript(script)

    return change


def in_its_schema(old: str, new: str) -> Callable[[sqlite3.Connection], None]:
    return written(
        "PRAGMA writable_schema=ON;"
        f"UPDATE sqlite_master SET sql = replace(sql, '{old}', '{new}') WHERE name = 'rows';"
    )


def replaced(table: str, *statements: str) -> Callable[[sqlite3.Connection], None]:
    return written(";".join((f"DROP TABLE {table}", *statements)))


ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i FROM n"
HOSTILE = {
    "a view": replaced("rows", f"CREATE VIEW rows AS {ENDLESS}"),
    "an endless view of metadata": replaced(
        "meta", f"CREATE VIEW meta AS SELECT i AS key, i AS value FROM ({ENDLESS})"
    ),
    "another schema": replaced("rows", "CREATE TABLE rows (time_s REAL, position_rad REAL)"),
    "no table": replaced("events"),
    "a generated column": replaced(
        "rows",
        schema(ONE_AXIS)["rows"].replace(
            "delay_s REAL", "delay_s REAL AS (hex(zeroblob(1000000)))"
        ),
    ),
    "a check": replaced(
        "rows", schema(ONE_AXIS)["rows"].replace("REAL,", "REAL CHECK (randomblob(9)),", 1)
    ),
    "seventeen axes": replaced("rows", schema([f"a{k}" for k in range(17)])["rows"]),
    "a name of no axis": replaced("rows", schema(["a b"])["rows"]),
    "half an axis": replaced("rows", 'CREATE TABLE rows (time_s REAL, "a.position_rad" REAL)'),
    "another type": in_its_schema("torque_nm REAL", "torque_nm TEXT"),
    "a text": written("UPDATE rows SET torque_nm = 'text' WHERE seq = 5000"),
    "a blob": written("UPDATE rows SET torque_nm = zeroblob(20) WHERE seq = 5000"),
    "a large blob": written("UPDATE rows SET torque_nm = zeroblob(40000000) WHERE seq = 5000"),
    "a large text": written("UPDATE meta SET value = '\"' || hex(zeroblob(20000000)) || '\"'"),
    "many texts": written(
        f"INSERT INTO events SELECT 0, (SELECT text FROM events) FROM ({ENDLESS} LIMIT 60000)"
    ),
    "a time that goes back": written("UPDATE rows SET time_s = 0.5 WHERE seq = 5000"),
    "no time": written("UPDATE rows SET time_s = NULL WHERE seq = 5000"),
    "an endless time": written("UPDATE rows SET time_s = 9e999 WHERE seq = 5000"),
    "an immense number": written("UPDATE rows SET position_rad = 1e308 WHERE seq = 5000"),
    "a name that is no text, in SQLite's complaint": written(
        "PRAGMA writable_schema=ON;"
        "UPDATE sqlite_master SET name = CAST(x'85' AS TEXT), sql = 'no' WHERE name = 'events';"
    ),
    "a fraction for a whole number": written("UPDATE rows SET flags = 0.5 WHERE seq = 5000"),
    "an unknown state": written("UPDATE rows SET oscillation = 99 WHERE seq = 5000"),
    "no JSON": written("UPDATE meta SET value = '{' WHERE key = 'config'"),
    "deep JSON": written(
        "UPDATE meta SET value = replace(hex(zeroblob(50000)), '0', '[') WHERE key = 'config'"
    ),
    "an origin that is no time": written("UPDATE meta SET value = '1e5' WHERE key = 'origin_ns'"),
    "bytes that are no text": written("UPDATE meta SET value = x'ff' WHERE key = 'name'"),
    "a report of a list": written("UPDATE meta SET value = '[]' WHERE key = 'report'"),
    "an event of a number": written("UPDATE events SET text = '5'"),
    "an event with a list as its row": written(
        "UPDATE events SET text = json_set(text, '$.row', json('[]'))"
    ),
}


@pytest.mark.parametrize("how", sampled(HOSTILE, 2))
def test_what_no_run_writes_is_refused_in_one_sentence(
    log: Path, capsys: pytest.CaptureFixture[str], how: str
) -> None:
    with closing(sqlite3.connect(log, isolation_level=None)) as db:
        HOSTILE[how](db)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for command in ("log", "detect"):
        begun = time.process_time()
        status, text = told(capsys, command, log)
        assert (status, text.count("\n")) == (2, 1), text
        assert time.process_time() - begun < 5.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000, "200 MB"


def test_what_a_log_has_besides_is_not_looked_at(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with closing(sqlite3.connect(log)) as db:
        db.executescript(
            f"CREATE TABLE mine (a); CREATE VIEW v AS {ENDLESS}; CREATE INDEX i ON rows (flags);"
            "CREATE TRIGGER t AFTER INSERT ON rows BEGIN DELETE FROM rows; END"
        )
    assert told(capsys, "log", log)[0] == 0
    with LogWriter(log, {}, resume=True):
        pass


def nested(depth: int) -> Any:
    return [nested(depth - 1)] if depth else "deep"


@pytest.mark.parametrize(
    ("words", "changed", "said"),
    [
        (("log",), {"torque": {"max": 10**400, "saturated_ticks": 0}}, "is not that of a run"),
        (("log", "--json"), {"explanation": nested(490)}, "nested too deeply"),
    ],
)
def test_a_report_that_no_run_writes_is_refused(
    log: Path, cli: Cli, words: tuple[str, ...], changed: dict[str, Any], said: str
) -> None:
    append_end(log, REPORT | changed)
    assert said in cli.refused(*words, log)


@pytest.mark.parametrize("told_by", [3, {"state": []}, {"state": "quiet", "amplitude_rad": "a"}])
def test_a_verdict_that_no_run_writes_is_not_believed(
    log: Path, capsys: pytest.CaptureFixture[str], told_by: Any
) -> None:
    append_end(log, REPORT | {"oscillation": told_by})
    status, text = told(capsys, "detect", log)
    assert status == 0 and text.startswith("state       quiet") and OWN not in text


def damaged(random: Random, content: bytes) -> bytes:
    """The content as a failing disk, a cut or a hostile hand leaves it."""
    for _ in range(random.choice((1, 1, 2, 5))):
        start = random.randrange(len(content))
        kind = random.choice(("page", "bytes", "noise", "cut", "head", "twice"))
        if kind == "cut":
            return content[:start]
        if kind == "page":
            start -= start % 4096
        start = random.randrange(100) if kind == "head" else start
        length = {"page": 4096, "twice": 4096, "noise": 6000}.get(kind, random.choice((1, 2, 4)))
        new = bytes(length) if kind == "page" else random.randbytes(length)
        if kind == "twice":  # a page in place of another
            start -= start % 4096
            other = random.randrange(len(content) // 4096) * 4096
            new = content[other : other + 4096]
        content = content[:start] + new + content[start + length :]
    return content


def test_a_damaged_log_is_read_or_refused_in_one_sentence(
    log: Path, capsys: pytest.CaptureFixture[str], thorough: bool, wholly: bool
) -> None:
    whole = log.read_bytes()
    for number in range(3000 if thorough else 300 if wholly else 60):
        log.write_bytes(damaged(Random(f"damage {number}"), whole))
        for command in ("log",) if number % 10 else ("log", "detect"):
            begun = time.process_time()
            status, text = told(capsys, command, log)
            assert status == 0 or (status, text.count("\n")) == (2, 1), (number, text)
            assert time.process_time() - begun < 5.0


def kinds(folder: Path) -> Iterator[tuple[str, str]]:
    os.mkfifo(folder / "pipe")
    yield "pipe", "it is a pipe, not a file"
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind("socket")
        yield "socket", "it is a socket, not a file"
    (folder / "device").symlink_to("/dev/zero")
    yield "device", "it is a device, not a file"
    (folder / "folder").mkdir()
    yield "folder", "Is a directory"


@pytest.mark.parametrize("command", ["log", "detect"])
def test_what_may_never_end_is_refused_at_once(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, why in kinds(tmp_path):
        status, text = told(capsys, command, name)
        assert status == 2 and why in text
