"""``log`` tells what a run's log holds, and exports it for other tools."""

import csv
from pathlib import Path

import numpy as np
import pytest

from haptic_wall.controller.logs.writer import LogWriter, append_end
from haptic_wall.controller.report.run_panels import DrawnRun
from haptic_wall.controller.report.run_text import report_text
from haptic_wall.controller.runtime.telemetry import FLAG_CONTACT, FLAG_WARM_UP
from tests.cli.test_text import REPORT
from tests.support.program import Cli
from tests.support.rows import rows_of
from tests.support.told_logs import metadata

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    rows = rows_of(1001, torque=-0.123456789, age_ns=120_300, lateness_ns=2_000)
    rows["position"] = np.linspace(-0.1, 0.2, len(rows))
    rows["position"][0] = np.nan
    rows["outcome"][5] = 1
    rows["missed"][9] = 3
    rows["flags"][:101] = FLAG_WARM_UP
    rows["flags"][401:] = FLAG_CONTACT
    rows["lateness_ns"][700] = 60_000
    rows["oscillation"][500:520] = 2
    path = tmp_path / "run.hwlog"
    with LogWriter(path, metadata()) as writer:
        for start in range(0, 1001, 250):
            writer.append(rows[start : start + 250, None])
    return path


def test_a_log_tells_its_rows_and_the_report_of_its_run(log: Path, cli: Cli) -> None:
    found = cli.json("log", log)
    assert (found["rows"], found["from_s"], found["to_s"]) == (1001, 0.0, 1.0)
    assert found["metadata"]["config"]["wall"]["stiffness"] == 8.0 and found["report"] is None
    assert "1001 rows, from 0 to 1 s" in (text := cli("log", log).out)
    assert "not ended: it goes on, was killed" in text
    append_end(log, REPORT)
    assert report_text(REPORT) in cli("log", log).out
    assert cli.json("log", log)["report"]["ticks"] == REPORT["ticks"]


def test_csv_has_the_columns_that_other_tools_read(log: Path, tmp_path: Path, cli: Cli) -> None:
    out = tmp_path / "run.csv"
    cli("log", log, "--csv", out)
    with out.open(newline="") as file:
        table = list(csv.DictReader(file))
    assert len(table) == 1001
    assert list(table[0])[:3] == ["time_s", "position_rad", "torque_nm"]
    assert table[0]["position_rad"] == ""  # not known: no reading yet
    assert table[0]["time_s"] == "0.0"
    assert table[3]["time_s"] == "0.003"
    assert float(table[-1]["position_rad"]) == 0.2
    assert float(table[-1]["torque_nm"]) == -0.123456789
    assert table[1]["sample_age_us"] == "120.3"
    assert table[5]["outcome"] == "1"


def test_a_log_without_rows_is_shown_but_not_exported(tmp_path: Path, cli: Cli) -> None:
    path = tmp_path / "empty.hwlog"
    LogWriter(path, {"name": "simulated", "program": "haptic-wall"}).close()
    assert "0 rows" in cli("log", path).out
    assert cli.json("log", path)["to_s"] is None
    assert "holds no rows" in cli.refused("log", path, "--csv", tmp_path / "run.csv")


def test_a_stretch_is_shown_and_exported_by_the_log_s_time(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli
) -> None:
    stretch = (log, "--from", 0.3, "--to", 0.6)
    summary = cli.json("log", *stretch)
    assert (summary["rows"], summary["from_s"], summary["to_s"]) == (300, 0.3, 0.599)
    cli("log", *stretch, "--csv", tmp_path / "a.csv")
    with (tmp_path / "a.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert (table[0]["time_s"], table[-1]["time_s"], len(table)) == ("0.3", "0.599", 300)
    drawn = []

    def keep(run: DrawnRun, _name: str, path: Path, _reason: str) -> None:
        drawn.append(run.time)
        path.touch()

    monkeypatch.setattr("haptic_wall.controller.report.run.plot_run", keep)
    cli("log", *stretch, "--plot", tmp_path / "a.png")
    assert (drawn[0][0], drawn[0][-1]) == pytest.approx((0.3, 0.599))
