"""``haptic-wall map`` writes a table, a report and a picture, and says what it cannot map."""

from __future__ import annotations

import csv
import json
import os
import signal
import time
from concurrent.futures import Executor
from contextlib import nullcontext
from pathlib import Path

import pytest

from haptic_wall.controller.experiments.maps import maps
from haptic_wall.controller.experiments.maps.servo import MapSettings
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory import critical_stiffness
from tests.cases import whole_only
from tests.support.executors import AtOnce
from tests.support.program import Cli, started

pytestmark = pytest.mark.usefixtures("undrawn")

ROWS = "map.rows"
PNG = b"\x89PNG\r\n\x1a\n"


def _computed_by(executor: Executor, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(maps, "processes", lambda _count: nullcontext(executor))


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch) -> None:
    """The pool of processes has tests of its own, and one takes half a second to start."""
    _computed_by(AtOnce(), monkeypatch)


def test_the_files_and_the_report_hold_every_point(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("kept")
    plane = ("--virtual-damping=-0.05,0.4", "--delay-steps", "0,2")
    report = cli.json("map", "paper-table2", *plane, "--workers", 1, "--out", tmp_path)
    points = report["points"]
    assert report["complete"]
    assert report["side"] == "both"
    assert [(p["delay_steps"], p["virtual_damping"]) for p in points] == [
        (0, -0.05), (0, 0.4), (2, -0.05), (2, 0.4)
    ]  # fmt: skip
    for point in points:
        exact = critical_stiffness(1.0, 0.1, point["virtual_damping"], 1e-3, point["delay_s"])
        assert point["exact"] == pytest.approx(float(exact))
        assert point["simulated"] == pytest.approx(float(exact), rel=1e-3)
        assert point["outcome"] == "grows above"
    written = json.loads((tmp_path / "map.json").read_text())
    assert written["points"] == points
    with (tmp_path / "map.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["simulated"]) for row in rows] == [p["simulated"] for p in points]
    assert (tmp_path / "map.png").read_bytes().startswith(PNG)
    assert (tmp_path / "mine.txt").read_text() == "kept"
    assert sorted(Path(name).name for name in report["files"]) == [
        "map.csv", "map.json", "map.png"
    ]  # fmt: skip


@pytest.mark.whole
@pytest.mark.realtime
@pytest.mark.parametrize("impatient", [whole_only(False), True])
def test_ctrl_c_ends_it_without_a_traceback_and_says_what_is_kept(
    tmp_path: Path, impatient: bool
) -> None:
    with started("map", "simulated", "--out", tmp_path, "--json") as command:
        assert command.stderr is not None
        first = command.stderr.readline()
        time.sleep(1.5)  # nothing is lost if the pool is not up yet
        os.killpg(command.pid, signal.SIGINT)  # as a terminal does: to all of them
        if impatient:
            os.killpg(command.pid, signal.SIGINT)
        out, err = command.communicate(timeout=60)
    assert command.returncode == 130, first + err
    assert "Traceback" not in first + err
    report = json.loads(out) if out else {"error": "interrupted"}
    if "error" not in report:  # it had computed something, unless the machine is very busy
        assert "interrupted" in err
        assert not report["complete"]
        assert (tmp_path / "map.png").read_bytes().startswith(PNG)


_FEW = (
    *("simulated", "--set", "servo.torque_step=0", "--virtual-damping=0,0.1"),
    *("--delay-steps=0,1,2", "--kick=0.1"),
)


def _unfinished(folder: Path) -> None:
    """Leave what a map that is killed in its third task leaves."""
    setting = MapSettings.of(load_config("simulated", ("servo.torque_step=0",)).config)
    question = maps.MapQuestion(setting, [0.0, 0.1], [0, 1, 2], [0.1])
    kept = question.kept(folder / ROWS, fresh=False)
    for task in question.tasks()[:2]:
        kept.add(task, question.compute(task)())
    with (folder / ROWS).open("a") as file:
        file.write("[[1, 0], [11.5")


@pytest.mark.whole
def test_a_killed_map_goes_on_and_ends_with_the_same_bytes(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, whole = tmp_path / "killed", tmp_path / "whole"
    folder.mkdir()
    _unfinished(folder)
    left = AtOnce()
    _computed_by(left, monkeypatch)
    assert cli("map", *_FEW, "--out", folder)[0] == 0
    assert left.tasks == 4
    assert cli("map", *_FEW, "--out", whole)[0] == 0
    names = sorted(path.name for path in whole.iterdir())
    assert names == ["map.csv", "map.json", "map.png"]
    assert sorted(path.name for path in folder.iterdir()) == names
    for name in ("map.csv", "map.png"):
        assert (folder / name).read_bytes() == (whole / name).read_bytes()
    one, other = (json.loads((each / "map.json").read_text()) for each in (folder, whole))
    assert one | {"files": []} == other | {"files": []}
