"""``run`` writes where it is told, never one file over another, and ends with its report."""

import json
import os
import signal
import time
from pathlib import Path

import click
import pytest
from click.core import Context

from haptic_wall.controller.cli import run as run_command
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.writer import LogWriter
from haptic_wall.controller.processes.plan import LogState
from haptic_wall.controller.processes.run_report import exit_status
from haptic_wall.controller.report.run_text import report_text
from haptic_wall.controller.runtime.safety import End, StopReason, Trip
from tests.support.program import Cli
from tests.support.rows import rows_of

pytestmark = pytest.mark.usefixtures("undrawn")

BRIEF = ("--set=loop.clock=simulated", "--duration=0.1", "--json")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("log", "picture"), [("a.hwlog", "a.png"), ("a", "a.png"), ("a.b", "a.b.png")]
)
def test_the_picture_goes_beside_an_explicit_log(
    cli: Cli, folder: Path, monkeypatch: pytest.MonkeyPatch, log: str, picture: str
) -> None:
    monkeypatch.setattr(
        "haptic_wall.controller.report.run.plot_log", lambda _rows, path, **_: path.touch()
    )
    assert cli.json("run", *BRIEF, "--log", log)["plot"] == picture
    assert {each.name for each in folder.iterdir()} == {log, picture}
    Path(log).unlink()
    Path(picture).write_text("mine")
    assert f"--plot {picture}" in cli.refused("run", *BRIEF, "--log", log)
    assert Path(picture).read_text() == "mine"


def test_no_file_and_no_device_gives_way_to_a_log(cli: Cli, folder: Path) -> None:
    """SQLite keeps files beside it."""
    (folder / "a-wal").write_text("mine")
    for force in ([], ["--force"]):
        err = cli.refused("run", *BRIEF, "--log", "a", *force)
        assert "a-wal is in the way" in err and (folder / "a-wal").read_text() == "mine"
        assert "/dev/null is a device" in cli.refused("run", *BRIEF, "--log", "/dev/null", *force)
    assert Path("/dev/null").is_char_device()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_signal_while_the_picture_is_drawn_costs_the_picture_only(
    cli: Cli, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    def impatient(*_: object) -> None:
        os.kill(os.getpid(), number)

    monkeypatch.setattr("haptic_wall.controller.report.run.plot_run", impatient)
    before = signal.getsignal(number)
    status, out, _ = cli("run", *BRIEF, "--log", "run.hwlog")
    report = json.loads(out)
    assert (status, report["stop_reason"], report["plot"]) == (0, "duration", None)
    assert any("no picture: interrupted" in warning for warning in report["warnings"])
    assert signal.getsignal(number) is before


def placed() -> tuple[tuple[Path, Path | None], Context]:
    """Where a run would write, and the context that keeps others from writing there."""
    names = ["-h", "--help"]  # a command keeps the first that it is asked for
    context = click.Context(run_command.command, help_option_names=names)
    with context.scope(cleanup=False):
        return run_command._places(None, None, None, "simulated", draws=True), context


def test_the_log_of_a_living_run_is_not_replaced(cli: Cli, folder: Path) -> None:
    with LogWriter(folder / "a.hwlog", {}) as log:
        log.append(rows_of(3)[:, None])
        told = cli.refused("run", *BRIEF, "--log", "a.hwlog", "--force")
        assert "another program has a.hwlog open" in told
    assert len(LogReader.open(folder / "a.hwlog").rows()) == 3
    assert cli("run", *BRIEF, "--log", "a.hwlog", "--force")[0] == 0


def test_two_runs_begun_together_do_not_write_one_file(monkeypatch: pytest.MonkeyPatch) -> None:
    """Though neither has written anything yet."""
    monkeypatch.setattr(time, "strftime", lambda _: "20260101-000000")
    first, context = placed()
    second, _ = placed()
    assert not set(first) & set(second)
    context.close()
    assert placed()[0] == first, "and later it is free again"


MINE = {"notes.txt": b"mine", "photo.png": b"\x89PNG\r\n\x1a\n" + 300 * b"x", "empty": b""}


def test_a_run_that_cannot_start_touches_no_file(cli: Cli, folder: Path) -> None:
    """Neither what is not of this program, nor log and picture of an earlier run."""
    assert cli("run", *BRIEF, "--log", "old.hwlog", "--plot", "old.png")[0] == 0
    for name, content in MINE.items():
        (folder / name).write_bytes(content)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    nowhere = ["xm430-w350", "--set", "servo.port=/dev/ttyNONE", "--set", "loop.clock=monotonic"]
    for log, plot, status in (
        ("notes.txt", "photo.png", 2),
        ("old.hwlog", "new.png", 2),
        ("new.hwlog", "old.png", 2),
        ("empty", "new.png", 4),
        ("new", "new.png", 4),
    ):
        assert cli("run", *BRIEF, *nowhere, "--log", log, "--plot", plot)[0] == status
    assert (
        cli("run", *BRIEF, *nowhere, "--log", "notes.txt", "--plot", "photo.png", "--force")[0] == 4
    )
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_files_are_replaced_when_it_is_said(cli: Cli, folder: Path) -> None:
    for name in ("notes.txt", "photo.png"):
        (folder / name).write_bytes(MINE[name])
    words = ("--log", "notes.txt", "--plot", "photo.png", "--force")
    assert cli("run", *BRIEF, *words)[0] == 0
    assert all((folder / name).read_bytes() != MINE[name] for name in ("notes.txt", "photo.png"))


@pytest.mark.parametrize(("how", "json_wanted"), [("removed", True), ("another", False)])
def test_a_log_that_is_gone_is_the_first_that_is_said(
    cli: Cli, folder: Path, monkeypatch: pytest.MonkeyPatch, how: str, json_wanted: bool
) -> None:
    log, close = folder / "run.hwlog", LogWriter.close

    def closed(writer: LogWriter) -> None:
        close(writer)
        log.rename(folder / "moved")
        if how == "another":
            log.write_text("mine")

    monkeypatch.setattr(LogWriter, "close", closed)
    words = ["--set=loop.clock=simulated", "--duration=0.1", "--log", str(log)]
    status, out, _ = cli("run", *words, *(["--json"] if json_wanted else []))
    assert status == 5
    if json_wanted:
        report = json.loads(out)
        assert (report["log_state"], report["log"], report["plot"]) == ("missing", None, None)
        assert any("is missing: " in warning for warning in report["warnings"])
    else:
        assert out.startswith("run         ended as planned, AND ITS LOG IS MISSING")
    if how == "another":
        assert log.read_text() == "mine", "and nothing was put behind it"


@pytest.mark.parametrize(
    ("reason", "waited_for", "log", "status"),
    [
        (End.DURATION, None, LogState.WHOLE, 0),
        (End.DURATION, None, LogState.INCOMPLETE, 5),
        (End.DURATION, None, LogState.MISSING, 5),
        (End.DURATION, "the dead man", LogState.MISSING, 3),
        (End.INTERRUPTED, None, LogState.MISSING, 130),
        (Trip.OVERSPEED, None, LogState.MISSING, 3),
        (Trip.SERVO_LOST, None, LogState.INCOMPLETE, 4),
    ],
)
def test_what_became_of_the_shaft_goes_before_what_became_of_the_log(
    reason: StopReason, waited_for: str | None, log: LogState, status: int
) -> None:
    assert exit_status(reason, waited_for, log) == status


@pytest.mark.parametrize(
    ("sets", "status"),
    [
        (["servo.damping=0", "wall.damping=0"], 3),
        (["wall.stiffness=0"], 0),
        (["guard.mode=off", "wall.damping=5"], 0),
    ],
)
def test_a_requested_wall_without_stiffness_is_no_success(
    cli: Cli, sets: list[str], status: int
) -> None:
    common = ["simulated", "--no-plot", "--duration", "0.1", "--set", "loop.clock=simulated"]
    arguments = [*common, *(word for each in sets for word in ("--set", each))]
    found, out, _ = cli("run", *BRIEF, *arguments)
    report = json.loads(out)
    assert (found, report["stop_reason"], report["wall_came_on"]) == (status, "duration", True)
    assert (report["no_stiffness"] is not None) == (status == 3)
    first = report_text(report, brief=True).replace("\n", " ")
    assert ("THE WALL HAS NO STIFFNESS: the guard commanded 0 of 8" in first) == (status == 3)
    assert ("ended as planned" in first) == (status == 0)
