"""Calls the command in this process."""

import gc
import json
from typing import Any, NamedTuple

import pytest

from haptic_wall.controller.cli.main import main
from tests.typed import status_of


def call(*words: object) -> int:
    """Call the command with these words; return its exit status."""
    try:
        return main([str(word) for word in words])
    except SystemExit as ended:
        return status_of(ended)
    finally:
        gc.enable()  # a run switches it off


class Answer(NamedTuple):
    """What a command answered."""

    status: int
    out: str
    err: str


class Cli:
    """``haptic-wall``, as a function of its words."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *words: object) -> Answer:
        """Call it, whatever has been said before."""
        self._capsys.readouterr()
        return Answer(call(*words), *self._capsys.readouterr())

    def json(self, *words: object, status: int = 0) -> dict[str, Any]:
        """Return its answer with ``--json``, which holds no NaN."""
        answer = self(*words, "--json")
        assert answer.status == status, answer.err
        found: dict[str, Any] = json.loads(answer.out, parse_constant=pytest.fail)
        return found

    def refused(self, *words: object) -> str:
        """Return what it says of wrong words: status 2, and no answer but that with ``--json``."""
        status, out, err = self(*words)
        assert status == 2
        assert json.loads(out)["exit_status"] == 2 if "--json" in words else out == ""
        assert "Traceback" not in err
        return err
