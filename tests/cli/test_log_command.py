"""``log`` tells what a run's log holds, and exports it for other tools."""

import csv
import json

import numpy as np
import pytest
from click.testing import CliRunner

from controller.cli.log import command
from controller.config_load import load_config
from controller.errors import UserError
from controller.logfile import LogWriter
from controller.telemetry import ROW


@pytest.fixture
def log(tmp_path):
    rows = np.zeros(1001, ROW)
    rows["seq"] = np.arange(len(rows))
    rows["deadline_ns"] = 7_000_000_000 + 1_000_000 * rows["seq"]
    rows["position"] = np.linspace(-0.1, 0.2, len(rows))
    rows["position"][0] = np.nan
    rows["torque"] = -0.123456789
    rows["age_ns"] = 120_300
    rows["outcome"][5] = 1
    rows["missed"][9] = 3
    metadata = {
        "program": "haptic-wall 0.1.0",
        "name": "simulated",
        "config": load_config("simulated").config.model_dump(mode="json"),
    }
    path = tmp_path / "run.hwlog"
    with LogWriter(path, metadata, ROW) as writer:
        writer.append(rows)
    return path


def answer(*arguments):
    result = CliRunner().invoke(command, list(map(str, arguments)), catch_exceptions=False)
    assert result.exit_code == 0
    return result.stdout


def test_summary_as_json(log):
    summary = json.loads(answer(log, "--json"))
    assert summary["rows"] == 1001
    assert summary["duration_s"] == pytest.approx(1.0)
    assert summary["rate_hz"] == pytest.approx(1000.0)
    assert (summary["missed_ticks"], summary["failed_readings"]) == (3, 1)
    assert summary["position_rad"] == pytest.approx([-0.0997, 0.2])
    assert summary["metadata"]["config"]["wall"]["stiffness"] == 8.0


def test_summary_as_text(log):
    text = answer(log)
    assert "simulated servo, wall above 0.0 rad, K 8.0 N·m/rad, B 0.02 N·m·s/rad asked" in text
    assert "1001 in 1 s: 1000 Hz" in text
    assert "3 missed ticks, 1 failed readings, 0 rows not recorded" in text


def test_csv_has_the_columns_that_other_tools_read(log, tmp_path):
    out = tmp_path / "run.csv"
    answer(log, "--csv", out)
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


def test_picture_of_an_old_run(log, tmp_path):
    answer(log, "--plot", tmp_path / "run.png")
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")


def test_a_place_that_cannot_be_written_names_the_option(log, tmp_path):
    with pytest.raises(UserError, match=r"--csv .*nowhere.*: cannot be written: No such file"):
        answer(log, "--csv", tmp_path / "nowhere" / "run.csv")


@pytest.mark.parametrize("option", ["--csv", "--plot"])
def test_a_log_is_never_written_over_by_its_own_export(log, option, monkeypatch):
    before = log.read_bytes()
    monkeypatch.chdir(log.parent)
    with pytest.raises(UserError, match=f"LOG and {option} both name run.hwlog"):
        answer(log, option, log.name)
    assert log.read_bytes() == before


def test_a_picture_is_not_named_as_what_it_is_not(log, tmp_path):
    with pytest.raises(UserError, match=r"--plot .*run.pdf: found .* \.pdf, wanted .* \.png"):
        answer(log, "--plot", tmp_path / "run.pdf")
    assert not (tmp_path / "run.pdf").exists()


def test_a_log_without_rows_is_summarised_but_not_exported(tmp_path):
    path = tmp_path / "empty.hwlog"
    LogWriter(path, {"name": "simulated", "program": "haptic-wall"}, ROW).close()
    assert "rows        none" in answer(path)
    assert json.loads(answer(path, "--json"))["duration_s"] is None
    with pytest.raises(UserError, match="holds no rows"):
        answer(path, "--csv", tmp_path / "run.csv")
