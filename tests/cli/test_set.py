"""``haptic-wall set``: the answer names the run that was changed."""

from pathlib import Path
from typing import Any

import pytest

from haptic_wall.controller.live.run_socket import AliveRun, socket_of
from tests.support.program import Cli

TOLD: dict[str, Any] = {
    "applied": True,
    "changed": {"wall.stiffness": 4.0, "wall.damping": 0.02},
    "waited_s": 0.1,
    "guard": {"commanded": {"stiffness": 4.0, "damping": 0.02}, "reasons": ["because", "so"]},
}


@pytest.mark.parametrize("told", [TOLD, TOLD | {"changed": {}}])
def test_the_answer_names_the_run_and_is_one_line_where_it_is_piped(
    told: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli
) -> None:
    log = tmp_path / "runs" / "a.hwlog"
    runs = [AliveRun(socket_of(log), 1)]
    monkeypatch.setattr("haptic_wall.controller.live.run_socket.alive", lambda: runs)
    monkeypatch.setattr("haptic_wall.controller.live.ask.ask", lambda *_: told)
    for terminal in (False, True):
        monkeypatch.setattr("sys.stdout.isatty", lambda shown=terminal: shown)
        status, text, said = cli("set", "wall.stiffness=4")
        assert status == 0 and text.startswith(f"the run of {log}: ")
        assert said == f"no wall runs in this folder; the change is for the run of {log}\n"
        assert len(text.splitlines()) == (4 if terminal and told["changed"] else 1)
    monkeypatch.chdir(tmp_path)
    assert cli.json("set", "wall.stiffness=4")["log"] == str(log)
    assert not cli("set", "wall.stiffness=4").err
