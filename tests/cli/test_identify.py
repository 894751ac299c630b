import json
import os
import signal
import threading
from pathlib import Path
from typing import Any, NoReturn

import pytest

from haptic_wall.controller.experiments.testbed import Played, Testbed
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.settings.load import load_config
from tests.support.program import Cli

pytestmark = pytest.mark.usefixtures("undrawn")

QUICK = [
    "--set=loop.clock=simulated",
    "--set=servo.inertia=0.0018142",
    "--set=servo.damping=0.0036617",
    "--set=servo.coulomb=0.012833",
    "--set=servo.torque_limit=0.52",
]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.whole
def test_the_report_the_configuration_and_the_picture(cli: Cli) -> None:
    words = ["identify", "simulated", *QUICK, "--set=servo.delay=0.0012"]
    status, out, told = cli(*words, "--out=mine.yaml", "--plot=fit.png", "--json")
    report = json.loads(out)
    truths = {"inertia": 0.0018142, "damping": 0.0036617, "coulomb": 0.012833, "delay": 0.0012}
    for name, truth in truths.items():
        assert report[name]["value"] == pytest.approx(truth, rel=0.05)
        assert 0.0 < report[name]["stderr"] < 0.05 * truth
    assert (status, report["torque_gain"]) == (0, {"value": 1.0, "stderr": 0.0})
    assert report["torque_unit"] == "commanded"
    assert report["backlash"] is None
    assert "will move by itself" in told and "0.3 rad" in told
    assert Path("fit.png").read_bytes().startswith(b"\x89PNG")
    assert [LogReader.open(Path(log)).rows().size > 0 for log in report["logs"]]
    believed = load_config("mine.yaml").config.belief()
    assert believed.delay.low <= 0.0012 <= believed.delay.high
    report = cli.json("run", "mine.yaml", "--duration=0.05", "--no-plot")
    assert report["delay_s"]["device"] == believed.delay.high


def test_figures_are_printed_though_a_file_cannot_be_written(
    monkeypatch: pytest.MonkeyPatch, cli: Cli
) -> None:
    def full(*_: object) -> NoReturn:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("haptic_wall.controller.report.identify.plot_identification", full)
    words = ["identify", "simulated", *QUICK, "--set=loop.rate_hz=250"]  # a quarter of the rows
    said = cli(*words, "--out=mine.yaml", "--plot=fit.png", "--json")
    given = " ".join(f"--set {word.removeprefix('--set=')}" for word in words[2:])
    assert f"mine.yaml has {given} too" in said.err
    assert Path("mine.yaml").read_text().startswith(f"# simulated {given}, with its belief")
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
