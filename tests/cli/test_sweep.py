"""``haptic-wall sweep`` writes what it measured, goes on after Ctrl-C, and says what it refuses."""

import csv
import io
import json
import os
import signal
import time
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import pytest

from haptic_wall.controller.experiments.sweep import sweep as sweeping
from tests.support.program import Cli, call, started
from tests.typed import not_none

pytestmark = pytest.mark.usefixtures("undrawn")

PNG = b"\x89PNG\r\n\x1a\n"
PLANT = ("--set", "loop.clock=simulated", "--set", "servo.coulomb=0", "--set",
         "servo.counts_per_rev=0", "--set", "servo.torque_step=0")  # fmt: skip
POINTS = ("--virtual-damping=0.05,12", "--delay-steps=1,3")


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], str]:
    """A finished sweep."""
    folder = tmp_path_factory.mktemp("sweep") / "here"
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        assert call("sweep", "simulated", *PLANT, *POINTS, "--out", folder, "--json") == 0
    return folder, json.loads(out.getvalue()), err.getvalue()


def test_points_and_files(swept: tuple[Path, dict[str, Any], str]) -> None:
    folder, report, told = swept
    points = report["points"]
    # In the order asked for; the ceiling is 9.9 at 1 ms.
    assert [(p["delay_steps"], p["virtual_damping"]) for p in points] == [
        (1, 0.05), (1, 12.0), (3, 0.05), (3, 12.0)
    ]  # fmt: skip
    good = [p for p in points if p["virtual_damping"] == 0.05]
    for point in good:
        assert point["measured"] == pytest.approx(point["exact"], rel=0.005)
        assert 0.0 < point["uncertainty"] < 0.005 * point["exact"]
        assert point["linear"] == pytest.approx(point["exact"], rel=0.01)
        assert point["frequency_hz"] > 1.0
        assert point["kick_rad"] > 0.0
        assert point["reason"] is None
    for point in points[1::2]:
        assert point["measured"] is None
        assert "above the ceiling" in point["reason"]
    assert report["complete"]
    held = json.loads((folder / "sweep.json").read_text())
    assert held["points"] == points
    with (folder / "sweep.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["measured"] for row in rows] == [
        "" if p["measured"] is None else str(p["measured"]) for p in points
    ]
    assert (folder / "sweep.png").read_bytes().startswith(PNG)
    for point in good:
        assert all((folder / "logs" / log).exists() for log in point["logs"])
    assert "4/4" in told


def test_the_same_settings_go_on_and_others_are_refused(
    swept: tuple[Path, dict[str, Any], str], cli: Cli
) -> None:
    folder, report, _ = swept
    before = json.loads((folder / "sweep.json").read_text())
    status, out, told = cli("sweep", "simulated", *PLANT, *POINTS, "--out", folder, "--json")
    assert status == 0
    assert json.loads(out)["points"] == report["points"]
    assert "4 of 4 points were measured before" in told
    told = cli.refused("sweep", "simulated", *PLANT, *POINTS, "--out", folder, "--kick=0.03")
    assert "other settings" in told
    assert "--force" in told
    assert json.loads((folder / "sweep.json").read_text()) == before


@pytest.mark.whole
def test_an_interrupted_sweep_keeps_what_is_finished(tmp_path: Path) -> None:
    many = [0.02 + 1e-4 * i for i in range(19)]  # however late the signal comes, some are left
    plane = (f"--virtual-damping=9,{','.join(map(str, many))}", "--delay-steps=3")
    with started("sweep", "simulated", *PLANT, *plane, "--out", tmp_path, "--json") as first:
        while "1/20" not in not_none(first.stderr).readline():
            assert first.poll() is None
        time.sleep(0.2)
        os.kill(first.pid, signal.SIGINT)
        out, told = first.communicate(timeout=60)
    assert first.returncode == 130
    assert "continues" in told
    kept = json.loads(out)["points"]
    assert not json.loads(out)["complete"]
    assert kept[0]["virtual_damping"] == 9.0
    held = json.loads((tmp_path / "sweep.json").read_text())
    assert held["points"] == kept


def test_a_sweep_that_measured_nothing_leaves_nothing(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweeping, "sweep", lambda *_, **__: False)
    status, _, told = cli("sweep", "simulated", *PLANT, *POINTS, "--out", tmp_path)
    assert (status, "nothing is written" in told) == (130, True)
    assert not list(tmp_path.glob("sweep.*"))


def test_a_line_that_no_sweep_wrote_is_refused(
    swept: tuple[Path, dict[str, Any], str], cli: Cli, tmp_path: Path
) -> None:
    kept = (swept[0] / "sweep.rows").read_text()
    wrong: list[Any] = [{}, {"virtual_damping": 0.1}, []]
    for line in wrong:
        (tmp_path / "sweep.rows").write_text(f"{kept}{json.dumps(line)}\n")
        told = cli.refused("sweep", "simulated", *PLANT, *POINTS, "--out", tmp_path)
        assert "sweep.rows, line 6" in told and "delete that line" in told
