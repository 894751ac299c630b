"""Short simulated walls give the rows that tests/same_rows.txt has digests of."""

from dataclasses import replace
from pathlib import Path

import pytest

from scripts import same_rows
from scripts.same_rows import (
    DIGESTS,
    Ran,
    change,
    first_difference,
    keep,
    kept,
    line_of,
    lines_in,
    machine,
    ran,
    rounded,
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


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("12345678.9", "1.23457e+07"),
        ("-0.1234567", "-1.23457e-01"),
        ("3e-14", "0.00000e+00"),
        ("-3e-14", "0.00000e+00"),
        ("-0.0", "0.00000e+00"),
        ("nan", "nan"),
        ("", ""),
        ("torque_nm", "torque_nm"),
    ],
)
def test_rounding(text: str, wanted: str) -> None:
    assert rounded(text) == wanted


def test_the_last_bit_counts_on_the_same_machine_only() -> None:
    was = Ran(ROWS, "duration", 0, "{}")
    now = replace(was, rows={**ROWS, "torque_nm": ["0.0", "-0.25000000000000006"]})
    before, after = line_of("a", was), line_of("a", now)
    assert not same(before, after, exactly=True)
    assert same(before, after, exactly=False)
    assert not same(before, replace(after, status=3), exactly=False)


def test_the_order_of_columns_does_not_count() -> None:
    other = dict(reversed(ROWS.items()))
    assert line_of("a", Ran(ROWS, "", 0, "{}")) == line_of("a", Ran(other, "", 0, "{}"))


@pytest.mark.parametrize(
    ("now", "words"),
    [
        (ROWS, ""),
        ({**ROWS, "torque_nm": ["0.0", "1.0"]}, "row 1, torque_nm: '-0.25' before, '1.0' now"),
        ({name: column[:1] for name, column in ROWS.items()}, "2 rows before, 1 now"),
        ({"time_s": ROWS["time_s"]}, "no column torque_nm any more"),
        ({**ROWS, "phase": ["0", "0"]}, "new column phase"),
    ],
)
def test_the_first_difference_is_named(now: dict[str, list[str]], words: str) -> None:
    assert first_difference(ROWS, now) == words


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
