"""No picture costs a result, and no setting of the user's Matplotlib changes a picture."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

import pytest

from haptic_wall.controller.logs.file import SUFFIX
from tests.cases import sampled
from tests.cli.caller import Cli

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


@pytest.mark.whole
@pytest.mark.parametrize(
    "settings",
    sampled(
        [
            {"MPLBACKEND": "module://matplotlib_inline.backend_that_is_not_there"},
            {"MPLBACKEND": "Qt4Agg"},
            {"MATPLOTLIBRC": "matplotlibrc"},
        ],
        3,
    ),
    ids=["notebook", "old backend", "latex"],
)
def test_no_setting_of_the_user_changes_a_picture(
    settings: dict[str, str], tmp_path: Path, cli: Cli
) -> None:
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\nfont.size: 30\nbackend: TkAgg\n")
    words = ["boundary", "simulated", "--virtual-damping=0.02"]
    program = [sys.executable, "-m", "haptic_wall.controller.cli.main"]
    done = subprocess.run(
        [*program, *words, "--plot", tmp_path / "a.png"],
        cwd=tmp_path,
        env={**os.environ, **settings},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    cli(*words, "--plot", str(tmp_path / "b.png"), "--json")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
