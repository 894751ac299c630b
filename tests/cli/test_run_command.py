"""``run`` writes where it is told, never one file over another, and ends with its report."""

import json
import os
import signal

import pytest

from controller.cli import main as cli

BRIEF = ("--set=loop.clock=simulated", "--duration=0.1", "--json")


def run(capsys, *arguments):
    try:
        status = cli.main(["run", *BRIEF, *map(str, arguments)])
    except SystemExit as ended:
        status = ended.code
    captured = capsys.readouterr()
    return status, captured.out, captured.err


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--log", "a", "--plot", "./a"], "--log and --plot both name a"),
        (["--plot", "a.svg"], "--plot a.svg: found a name ending in .svg"),
        (["--log", "."], "--log: . is a folder"),
        (["--duration", "-1"], "--duration: found -1"),
        (["--witness", "a"], "--witness: only an emulated bus"),
    ],
)
def test_a_wrong_place_or_time_is_refused_before_the_start(capsys, folder, arguments, message):
    status, out, err = run(capsys, *arguments)
    assert (status, out) == (2, "")
    assert message in err
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_while_the_picture_is_drawn_costs_the_picture_only(capsys, monkeypatch, number):
    def impatient(*_):
        os.kill(os.getpid(), number)

    monkeypatch.setattr("controller.plot.plot_run", impatient)
    before = signal.getsignal(number)
    status, out, _ = run(capsys, "--log", "run.hwlog")
    report = json.loads(out)
    assert (status, report["stop_reason"], report["plot"]) == (0, "duration", None)
    assert any("no picture: interrupted" in warning for warning in report["warnings"])
    assert signal.getsignal(number) is before
