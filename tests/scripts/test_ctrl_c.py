"""Of made-up tries each that ended as it must not is found, and none is invented."""

import signal
from dataclasses import replace
from pathlib import Path

import pytest

from haptic_wall.controller.cli.main import COMMANDS
from scripts.studies.ctrl_c import CASES, LIMIT_S, STUDY, Try, batches, cells
from scripts.study import Kept, usual

ENDED = Try("run", signal.SIGINT, 1.2, False, 130, 0.4, "run   interrupted", 0, 0, 0)
TERMINATED = replace(ENDED, number=signal.SIGTERM)
EMULATE = replace(ENDED, name="emulate", torque=None)


@pytest.mark.parametrize(
    ("found", "wanted"),
    [
        (ENDED, True),
        (replace(ENDED, status=-signal.SIGINT), True),  # Python had not begun
        (replace(ENDED, status=0), False),  # it was swallowed
        (replace(ENDED, status=0, ended_s=0.01), True),  # at its end already
        (replace(ENDED, status=0, before=True), True),
        (replace(ENDED, status=1), False),
        (replace(ENDED, status=3), False),
        (replace(ENDED, status=None), False),
        (replace(ENDED, ended_s=LIMIT_S + 0.1), False),
        (replace(ENDED, said="Traceback (most recent call last):"), False),
        (replace(ENDED, said="Exception ignored in: <function ...>"), False),
        (replace(ENDED, torque=1), False),
        (replace(ENDED, left=1), False),
        (replace(ENDED, half=1), False),
        (TERMINATED, True),
        (replace(TERMINATED, status=-signal.SIGTERM), True),
        (replace(TERMINATED, status=-signal.SIGINT), False),
        (EMULATE, True),
        (replace(EMULATE, status=0), False),
        (replace(EMULATE, number=signal.SIGHUP, status=0), True),  # that is how it is ended
    ],
)
def test_a_command_ends_as_asked_quietly_and_leaves_nothing(found: Try, wanted: bool) -> None:
    assert found.as_wanted == wanted


def test_a_line_of_the_table_counts() -> None:
    tries = [ENDED, ENDED, replace(ENDED, before=True), replace(ENDED, status=-2, ended_s=0.5)]
    counted = ["Ctrl-C", "run", "4", "1", "130: 2, -2: 1", "0.50", "0", "0", "0", "0"]
    assert cells(tries) == counted
    assert "–" in cells([EMULATE])


def test_every_command_is_tried() -> None:
    assert {words[0] for words in CASES.values()} == set(COMMANDS)


def test_every_command_is_in_one_part() -> None:
    parts = [{batch.name for batch in part.cases(usual(STUDY))} for part in STUDY.parts]
    assert sorted(name for part in parts for name in part) == sorted(CASES)


def test_the_commands_that_matter_most_come_first_and_each_as_often_as_asked() -> None:
    lots = list(batches(usual(STUDY, tries=50, others=0, commands="run")))
    assert [lot.name for lot in lots[:3]] == ["run"] * 3
    assert sum(lot.tries for lot in lots if lot.name == "run, simulated") == 50


def test_tries_are_kept_and_read_again(tmp_path: Path) -> None:
    part, _ = STUDY.parts
    (batch, *_) = batches(usual(STUDY))
    file = tmp_path / "rows"
    Kept(file).add(part, batch, [ENDED, replace(TERMINATED, status=None, said="Traceback")])
    found = Kept(file).rows(part, [batch])[0]
    assert [each.as_wanted for each in found] == [True, False]
    assert (found[1].number, found[1].said) == (signal.SIGTERM, "Traceback")
