"""No picture costs a result, and no setting of the user's Matplotlib changes a picture."""

import json
from pathlib import Path
from typing import NoReturn

import pytest

from haptic_wall.controller.logs.file import SUFFIX
from tests.support.program import Cli

SIMULATED = "simulated", "--set", "loop.clock=simulated"
LOG = f"run{SUFFIX}"
RUN = "run", *SIMULATED, "--duration=0.3", "--log", LOG
SWEEP = "--virtual-damping=0.02", "--delay-steps=0", "--kick=0.05"
DRAWING = {
    "run": RUN,
    "boundary": ("boundary", "simulated", "--virtual-damping=0.02", "--plot=a.png"),
    "detect": ("detect", LOG, "--plot=a.png"),
    "sweep": ("sweep", *SIMULATED, *SWEEP, "--out=a"),
}


@pytest.mark.whole
@pytest.mark.parametrize("name", DRAWING)
def test_no_picture_costs_the_result(
    name: str, cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> NoReturn:
        raise RuntimeError("libfreetype is missing")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("haptic_wall.controller.report.style.drawing", broken)
    if LOG in DRAWING[name] and name != "run":
        cli(*RUN, "--no-plot", "--json")
    status, out, err = cli(*DRAWING[name], "--json")
    assert status == 0, err
    assert json.loads(out)
    assert "libfreetype is missing" in out + err and "Traceback" not in err
    assert list(tmp_path.rglob("*.png")) == []
