"""The study of a tick's parts: its tables count what they say, and a missing compiler is told."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from haptic_wall.controller.errors import PlatformError
from scripts.bus_calls import Calls
from scripts.compiled_package import SIMULATED, compiled
from scripts.loop_rounds import Round, Turn, rate_lines, turn_lines
from scripts.studies.compiled_tick import (
    STUDY,
    LevelTimes,
    Wall,
    call_lines,
    level_lines,
    wall_lines,
)
from scripts.tick_steps import Level

ROUNDS = [Round(number, 4.0) for number in range(2)]


def turn(name: str, work: float) -> Turn:
    return Turn(name, "bare", work, 2.0 * work, 10.0, 40.0, 0.001)


def test_a_ratio_is_that_of_the_same_round() -> None:
    found = [
        (ROUNDS[0], [turn("bare", 10.0), turn("ours", 20.0)]),
        (ROUNDS[1], [turn("bare", 20.0), turn("ours", 60.0)]),
    ]
    bare, ours = turn_lines(found)[2:4]
    assert bare.startswith("| bare | 15 |  | 30 |  | 10 |  | 40 |  | 0.1 % |")
    assert ours.startswith("| ours | 40 | 2.50 (2.00 to 3.00) | 80 | 2.50 (2.00 to 3.00) | 10 |")


def test_a_rate_that_was_never_held_has_no_ratio() -> None:
    held = {"bare": 4000.0, "ours": 3000.0}
    assert rate_lines([(0, held)], "bare")[2:] == [
        "| bare | 4000 |  |",
        "| ours | 3000 | 0.75 (0.75 to 0.75) |",
    ]
    for lost in held:
        told = rate_lines([(0, held), (1, {**held, lost: 0.0})], "bare")
        assert sum("not always above 500" in line for line in told) == 1
        assert not any("0.75" in line for line in told)


def test_each_level_is_told_with_its_difference_to_the_one_before() -> None:
    found = [
        (
            each,
            [
                LevelTimes(level, fast, (10.0 + 2.0 * level) / (1.0 + fast), 30.0, {})
                for level in Level
                for fast in (False, True)
            ],
        )
        for each in ROUNDS
    ]
    first, *_, last = level_lines(found)[2 : 2 + len(Level)]
    same, half = "1.00 (1.00 to 1.00)", "0.50 (0.50 to 0.50)"
    assert first.endswith(f"| 10.0 |  | {same} | 30.0 | 5.0 | {half} | 30.0 |")
    over, fast = "2.60 (2.60 to 2.60)", "1.30 (1.30 to 1.30)"
    assert last.endswith(f"| 26.0 | +2.0 | {over} | 30.0 | 13.0 | {fast} | 30.0 |")


def test_calls_are_added_by_their_number_in_a_tick() -> None:
    bare = LevelTimes(Level.BYTES, False, 1.0, 1.0, {"write": [2.0, 3.0], "read": [1.0, 1.0]})
    tick = LevelTimes(Level.TICK, False, 1.0, 1.0, {"write": [2.0, 4.0]})
    rows = call_lines([(ROUNDS[0], [bare, tick])])
    assert rows[2:] == [
        "| write | 2.00 | 3.0 | 2.00 | 4.0 |",
        "| read | 1.00 | 1.0 | 0.00 | 0.0 |",
        "| all, a tick |  | 7.0 |  | 8.0 |",
    ]


def test_the_time_of_timing_is_subtracted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each look at the clock takes 100 ns, the call 300 ns more."""
    clock = iter(range(0, 10**9, 100))
    fake = SimpleNamespace(monotonic_ns=lambda: next(clock))
    monkeypatch.setattr("scripts.bus_calls.time", fake)
    calls = Calls()

    def slow() -> None:
        for _ in range(3):
            next(clock)

    for _ in range(4):
        calls.timed("slow", slow)
    assert calls.figures(2) == {"slow": [2.0, pytest.approx(0.3)]}
    assert calls.figures(2) == {}


def test_a_wall_with_other_rows_is_named_and_not_wanted() -> None:
    count = len(SIMULATED)
    found = [("push", Wall(True, count)), ("tap", Wall(False, count - 1))]
    (told,) = wall_lines(found)
    assert told.startswith(f"{count - 1} of {count} modules compiled. 1 of 2 simulated walls")
    assert told.endswith(": others are tap.")
    wanted = next(part.wanted for part in STUDY.parts if part.name == "rows")
    assert wanted(found[:1]) and not wanted(found)


def test_a_missing_compiler_is_told_before_anything_is_copied(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scripts.compiled_package.shutil.which", lambda _name: None)
    with pytest.raises(PlatformError, match="no C compiler"):
        compiled(tmp_path)
    monkeypatch.setattr("scripts.compiled_package.importlib.util.find_spec", lambda _name: None)
    with pytest.raises(PlatformError, match="no mypyc"):
        compiled(tmp_path)
    assert not list(tmp_path.iterdir())
