"""Of made-up tries each that ended as it must not is found, and none is invented."""

import signal
from dataclasses import replace

import pytest

from haptic_wall.controller.cli.main import COMMANDS
from scripts.ctrl_c import CASES, LIMIT_S, Try, batches, keep, kept, row

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
def test_a_command_ends_as_asked_quietly_and_leaves_nothing(found, wanted):
    assert found.as_wanted == wanted


def test_a_line_of_the_table_counts():
    tries = [ENDED, ENDED, replace(ENDED, before=True), replace(ENDED, status=-2, ended_s=0.5)]
    assert row(tries) == "| Ctrl-C | run | 4 | 1 | 130: 2, -2: 1 | 0.50 | 0 | 0 | 0 | 0 |"
    assert "| – |" in row([EMULATE])


def test_every_command_is_tried():
    assert {words[0] for words in CASES.values()} == set(COMMANDS)


def test_a_later_call_goes_on_where_one_ended(tmp_path):
    results = tmp_path / "tries"
    assert kept(results) == []
    keep(results, [ENDED] * 30)
    keep(results, [replace(ENDED, status=0, said="Traceback")])
    found = kept(results)
    assert [each.as_wanted for each in found] == [True] * 30 + [False]
    assert found[-1].said == "Traceback"
    lots = list(batches({signal.SIGINT: 50}, "run", found))
    assert lots[:2] == [("run", signal.SIGINT, 9), ("run", signal.SIGINT, 10)]
    assert sum(tries for name, _, tries in lots if name == "run, simulated") == 50
