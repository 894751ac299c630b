"""An error carries the parts of its sentence, into other processes too."""

import pickle

import pytest

from haptic_wall.controller.errors import ConfigError, PlatformError, UserError
from haptic_wall.hw.errors import ExplainedError, PortError, Problem


@pytest.mark.parametrize(
    ("error", "text", "remedy"),
    [
        (UserError("no"), "no", None),
        (UserError("found 3", wanted="2"), "found 3, wanted 2", "wanted 2"),
        (UserError("found 3", wanted="2", advice="give 2"), "found 3, wanted 2; give 2", "give 2"),
        (UserError("found 3", field="--at", wanted="2"), "--at: found 3, wanted 2", "wanted 2"),
        (UserError("is 3", field="--at", given="x: y; z"), "--at x: y; z: is 3", None),
        (
            UserError(field="--at", given="and --to both say 3", advice="give one"),
            "--at and --to both say 3; give one",
            "give one",
        ),
        (PortError("It is gone", advice="plug it in."), "It is gone: plug it in.", "plug it in."),
        (PlatformError("no: memory", advice="wait"), "no: memory: wait", "wait"),
    ],
)
def test_an_error_has_parts_and_a_sentence(
    error: ExplainedError, text: str, remedy: str | None
) -> None:
    assert str(error) == text
    assert error.problem.remedy == remedy
    sent = pickle.loads(pickle.dumps(error))
    assert (type(sent), str(sent), sent.problem) == (type(error), text, error.problem)


def test_the_first_problem_of_a_configuration_stands_for_it() -> None:
    first = Problem("found 3", wanted="2", field="wall.stiffness", given="(from --set)")
    error = ConfigError("a.yaml", [first, Problem("unknown", field="wal")])
    assert error.problem == first
    assert error.problems == ("wall.stiffness (from --set): found 3, wanted 2", "wal: unknown")


def test_a_message_repeats_only_the_beginning_of_a_long_value() -> None:
    assert len(str(Problem("no such file", field="CONFIG", given="x" * 5000))) < 400
