"""Short simulated walls give the rows that tests/same_rows.txt has digests of."""

from dataclasses import replace
from pathlib import Path

import pytest

from scripts import same_rows
from scripts.same_rows import (
    DIGESTS,
    Ran,
    change,
    keep,
    kept,
    line_of,
    lines_in,
    machine,
    ran,
    same,
)
from scripts.same_rows_cases import CASES

SOME = ("below-tap", "guard-bounds", "oscillation-guard-off", "fault-late", "trip-travel")
MADE_ON, LINES = lines_in(DIGESTS.read_text("utf-8"))
ROWS = {"time_s": ["0.0", "0.001"], "torque_nm": ["0.0", "-0.25"]}


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "case" in metafunc.fixturenames:
        names = CASES if metafunc.config.getoption("thorough") else SOME
        metafunc.parametrize("case", names)


def test_rows_are_as_they_were(case: str) -> None:
    found = ran(CASES[case])
    now, exactly = line_of(case, found), machine() == MADE_ON
    told = change(LINES[case], now, kept(same_rows.KEPT, case), found)
    assert same(LINES[case], now, exactly=exactly), f"{told}; scripts/study same_rows tells more"


def test_each_run_has_a_line() -> None:
    assert list(LINES) == list(CASES)
    assert len(CASES) >= 60
    assert len({line.exact for line in LINES.values() if line.rows}) >= 60, "no two are the same"


def test_the_last_bit_counts_on_the_same_machine_only() -> None:
    was = Ran(ROWS, "duration", 0, "{}")
    now = replace(was, rows={**ROWS, "torque_nm": ["0.0", "-0.25000000000000006"]})
    before, after = line_of("a", was), line_of("a", now)
    assert not same(before, after, exactly=True)
    assert same(before, after, exactly=False)
    assert not same(before, replace(after, status=3), exactly=False)


def test_a_change_is_told_by_the_rows_that_were_kept(tmp_path: Path) -> None:
    was = Ran(ROWS, "duration", 0, '{"ticks": 2}')
    keep(tmp_path, "a", was)
    assert kept(tmp_path, "a") == was
    assert kept(tmp_path, "b") is None
    now = Ran({**ROWS, "torque_nm": ["0.5", "-0.25"]}, "trip:travel", 3, '{"ticks": 3}')
    before, after = line_of("a", was), line_of("a", now)
    told = change(before, after, was, now)
    for words in (
        "stop duration before, trip:travel now",
        "status 0 before, 3 now",
        "row 0, torque_nm: '0.0' before, '0.5' now",
        "the report: ticks 2 before, 3 now",
    ):
        assert words in told
    assert "not kept here" in change(before, after, None, now)
    assert change(None, after, None, now) == "new"
