"""Lines are as wide as COLUMNS says, and what is there to be copied is not broken."""

import pytest

from haptic_wall.controller.cli import wrapping

COMMAND = "`sudo prlimit --rtprio=95 --pid 4711`"


@pytest.mark.parametrize("columns", [40, 60, 98, 200])
def test_lines_are_as_wide_as_columns_says(monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    lines = wrapping.wrapped("word " * 100, "note        ", " " * 12)
    assert columns - 5 < max(map(len, lines)) <= columns
    assert lines[0].startswith("note        word")
    assert all(line.startswith(" " * 12 + "word") for line in lines[1:])


@pytest.mark.parametrize("columns", range(40, 80))
def test_a_command_stays_in_one_line(monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    lines = wrapping.wrapped(f"log in again, or once: {COMMAND}, which lasts until the next boot")
    assert sum(COMMAND in line for line in lines) == 1
