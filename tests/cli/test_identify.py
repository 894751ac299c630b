import io
import json
import os
import signal
import threading
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import pytest

from haptic_wall.controller.cli.identify import _moved
from haptic_wall.controller.experiments.identify.identification import Identified
from haptic_wall.controller.experiments.testbed import Played, Testbed
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.settings.load import load_config
from tests.support.program import Cli, call

pytestmark = pytest.mark.usefixtures("undrawn")

QUICK = [
    "--set=loop.clock=simulated",
    "--set=servo.inertia=0.0018142",
    "--set=servo.damping=0.0036617",
    "--set=servo.coulomb=0.012833",
    "--set=servo.torque_limit=0.52",
]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


class Done(NamedTuple):
    """One identification."""

    folder: Path
    report: dict[str, Any]
    told: str
    found: Identified


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory, wholly: bool) -> Done:
    """The command with all of its files, taken once."""
    folder = tmp_path_factory.mktemp("identified")
    words = ["identify", "simulated", *QUICK, "--set=servo.delay=0.0012"]
    words += ["--out", "mine.yaml", "--plot", "fit.png", "--json"]
    words += [] if wholly else ["--set=loop.rate_hz=500"]  # half of the rows
    out, err, found = io.StringIO(), io.StringIO(), list[Identified]()

    def moved(*asked: Any) -> Identified:
        found.append(_moved(*asked))
        return found[0]

    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.chdir(folder)
        patch.setattr("haptic_wall.controller.cli.identify._moved", moved)
        assert call(*words) == 0
    return Done(folder, json.loads(out.getvalue()), err.getvalue(), found[0])


@pytest.mark.whole
def test_the_report_the_configuration_and_the_picture(
    done: Done, monkeypatch: pytest.MonkeyPatch, cli: Cli
) -> None:
    report = done.report
    truths = {"inertia": 0.0018142, "damping": 0.0036617, "coulomb": 0.012833, "delay": 0.0012}
    for name, truth in truths.items():
        assert report[name]["value"] == pytest.approx(truth, rel=0.05)
        assert 0.0 < report[name]["stderr"] < 0.05 * truth
    assert report["torque_gain"] == {"value": 1.0, "stderr": 0.0}
    assert report["torque_unit"] == "commanded"
    assert report["backlash"] is None
    assert "will move by itself" in done.told and "0.3 rad" in done.told
    monkeypatch.chdir(done.folder)
    assert Path("fit.png").read_bytes().startswith(b"\x89PNG")
    assert [LogReader.open(Path(log)).rows().size > 0 for log in report["logs"]]
    believed = load_config("mine.yaml").config.belief()
    assert believed.delay.low <= 0.0012 <= believed.delay.high
    report = cli.json("run", "mine.yaml", "--duration=0.05", "--no-plot")
    assert report["delay_s"]["device"] == believed.delay.high


def test_figures_are_printed_though_a_file_cannot_be_written(
    done: Done, monkeypatch: pytest.MonkeyPatch, cli: Cli
) -> None:
    def full(*_: object) -> NoReturn:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("haptic_wall.controller.cli.identify._moved", lambda *_: done.found)
    monkeypatch.setattr("haptic_wall.controller.report.identify.plot_identification", full)
    words = ["identify", "simulated", *QUICK, "--out=mine.yaml", "--plot=fit.png", "--json"]
    said = cli(*words)
    report = json.loads(said.out)
    assert report["inertia"]["value"] == pytest.approx(0.0018142, rel=0.05)
    assert (report["plot"], report["config"]) == (None, "mine.yaml")
    assert "--plot fit.png: cannot be written: No space left" in said.err


def test_ctrl_c_ends_it(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    # In real time the motions take half a minute: the signal comes within them.
    timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    whole = Testbed.play

    def play(*args: Any, **kwargs: Any) -> Played:
        if timer.ident is None:
            timer.start()
        return whole(*args, **kwargs)

    monkeypatch.setattr(Testbed, "play", play)
    words = ["identify", "simulated", *QUICK[1:], "--set=realtime.profile=off"]
    status, _, told = cli(*words)
    timer.join()
    assert status == 130 and "Traceback" not in told
