"""``run`` writes where it is told, never one file over another, and ends with its report."""

import json
import os
import signal
import time
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from controller.cli import main as cli
from controller.cli import run as run_command
from controller.log.file import LogWriter, read_log
from controller.telemetry import ROW

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
        (["--hold", "a", "--hold", "b"], "--hold: found 2 sources (a, b), wanted one"),
        (["--plot", "a.svg"], "--plot a.svg: found a name ending in .svg"),
        (["--log", "."], "--log: . is a folder"),
        (["--log", 300 * "x"], "x: File name too long; name another place"),
        (["--plot", 300 * "x"], "x: File name too long; name another place"),
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

    monkeypatch.setattr("controller.plots.run.plot_run", impatient)
    before = signal.getsignal(number)
    status, out, _ = run(capsys, "--log", "run.hwlog")
    report = json.loads(out)
    assert (status, report["stop_reason"], report["plot"]) == (0, "duration", None)
    assert any("no picture: interrupted" in warning for warning in report["warnings"])
    assert signal.getsignal(number) is before


def test_the_log_tells_how_the_run_ended(capsys, monkeypatch):
    monkeypatch.setattr("controller.plots.run.plot_run", lambda _s, _m, path, *_: path.touch())
    status, out, _ = run(capsys, "--log", "run.hwlog", "--set", "safety.max_speed=1e-9")
    assert cli.main(["log", "run.hwlog", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["stop_reason"] == json.loads(out)["stop_reason"]
    assert told["unrecorded_rows"] == 0
    assert told["rows"] >= json.loads(out)["ticks"]
    assert (status == 3) == told["stop_reason"].startswith("trip:")


def test_the_same_run_gives_the_same_log(capsys, folder, monkeypatch):
    monkeypatch.setattr("controller.plots.run.plot_run", lambda _s, _m, path, *_: path.touch())
    for name in ("a", "b"):
        assert run(capsys, "--log", f"{name}.hwlog")[0] == 0
    assert (folder / "a.hwlog").read_bytes() == (folder / "b.hwlog").read_bytes()


def test_a_log_that_another_run_is_writing_is_not_taken_from_it(capsys, folder):
    log = folder / "mine.hwlog"
    with LogWriter(log, {}, ROW) as writer:
        status, out, err = run(capsys, "--log", log)
        assert (status, out) == (2, "")
        assert "another run is writing" in err
        writer.append(np.zeros(3, ROW))
    assert len(read_log(log)[1]) == 3
    assert run(capsys, "--log", log)[0] == 0


def test_two_runs_begun_together_do_not_write_one_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(time, "strftime", lambda _: "20260101-000000")
    first, picture = run_command._places(None, None, None, "simulated")
    exists = Path.exists
    looks = iter([False])  # the other takes the name just after it was looked for
    monkeypatch.setattr(Path, "exists", lambda path: next(looks, exists(path)))
    second, another = run_command._places(None, None, None, "simulated")
    assert first.exists()
    assert second.exists()
    assert first != second
    assert picture != another


@pytest.mark.parametrize("option", ["--log", "--plot"])
def test_a_pipe_is_refused_before_anybody_waits_for_its_reader(capsys, tmp_path, option):
    os.mkfifo(tmp_path / "pipe")
    status, _, said = run(capsys, option, "pipe")
    assert status == 2
    assert f"{option}: pipe is a pipe; name a file" in said


@pytest.mark.parametrize("option", ["--log", "--plot"])
def test_the_configuration_is_not_written_over(capsys, folder, option):
    text = (resources.files("controller") / "presets/simulated.yaml").read_text()
    (folder / "mine").write_text(text)
    status, _, err = run(capsys, "./mine", option, "mine")
    assert status == 2
    assert f"CONFIG and {option} both name mine" in err
    assert (folder / "mine").read_text() == text


def test_a_preset_is_no_file_that_could_be_written_over(capsys, monkeypatch):
    monkeypatch.setattr("controller.plots.run.plot_run", lambda _s, _m, path, *_: path.touch())
    assert run(capsys, "simulated", "--log", "simulated")[0] == 0


def test_links_in_a_circle_are_told_in_a_sentence(capsys, folder):
    (folder / "one").symlink_to("other")
    (folder / "other").symlink_to("one")
    status, _, err = run(capsys, "--log", "one")
    assert (status, err) == (
        2,
        "haptic-wall: --log one: its links lead in a circle; name another place\n",
    )


def test_a_name_with_dots_is_kept_whole_and_taken_once(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(time, "strftime", lambda _: "now")
    names = ["wall.v1.yaml", "wall.v2.yaml", "wall.v2.yaml", "wall.v2.yaml"]
    found = [run_command._places(None, None, None, name) for name in names]
    stems = ["now-wall.v1", "now-wall.v2", "now-wall.v2+", "now-wall.v2++"]
    assert [(log.name, plot.name) for log, plot in found] == [
        (f"{stem}.hwlog", f"{stem}.png") for stem in stems
    ]
