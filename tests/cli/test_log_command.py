"""``log`` tells what a run's log holds, and exports it for other tools."""

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from click.testing import CliRunner

from haptic_wall.controller.cli.log import command
from haptic_wall.controller.cli.text import report_text
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.writer import LogWriter, append_end
from haptic_wall.controller.report.sketch import Sketch
from haptic_wall.controller.runtime.telemetry import FLAG_CONTACT, FLAG_WARM_UP, ROW
from haptic_wall.controller.settings.load import load_config
from tests.cli.caller import Cli
from tests.cli.test_text import REPORT

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    rows = np.zeros(1001, ROW)
    rows["seq"] = np.arange(len(rows))
    rows["deadline_ns"] = 7_000_000_000 + 1_000_000 * rows["seq"]
    rows["position"] = np.linspace(-0.1, 0.2, len(rows))
    rows["position"][0] = np.nan
    rows["torque"] = -0.123456789
    rows["age_ns"] = 120_300
    rows["outcome"][5] = 1
    rows["missed"][9] = 3
    rows["flags"][:101] = FLAG_WARM_UP
    rows["flags"][401:] = FLAG_CONTACT
    rows["lateness_ns"] = 2_000
    rows["lateness_ns"][700] = 60_000
    rows["oscillation"][500:520] = 2
    metadata = {
        "program": "haptic-wall 0.1.0",
        "name": "simulated",
        "config": load_config("simulated").config.model_dump(mode="json"),
    }
    path = tmp_path / "run.hwlog"
    with LogWriter(path, metadata) as writer:
        for start in range(0, 1001, 250):
            writer.append(rows[start : start + 250])
    return path


def answer(*arguments: str | float | Path) -> str:
    result = CliRunner().invoke(command, list(map(str, arguments)), catch_exceptions=False)
    assert result.exit_code == 0
    return result.stdout


def test_a_log_tells_its_rows_and_the_report_of_its_run(log: Path) -> None:
    found = json.loads(answer(log, "--json"))
    assert (found["rows"], found["from_s"], found["to_s"]) == (1001, 0.0, 1.0)
    assert found["metadata"]["config"]["wall"]["stiffness"] == 8.0 and found["report"] is None
    assert "1001 rows, from 0 to 1 s" in (text := answer(log))
    assert "not ended: it goes on, or was killed" in text
    append_end(log, REPORT)
    assert report_text(REPORT) in answer(log)
    assert json.loads(answer(log, "--json"))["report"]["ticks"] == REPORT["ticks"]


def test_csv_has_the_columns_that_other_tools_read(log: Path, tmp_path: Path) -> None:
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


def test_a_log_without_rows_is_shown_but_not_exported(tmp_path: Path) -> None:
    path = tmp_path / "empty.hwlog"
    LogWriter(path, {"name": "simulated", "program": "haptic-wall"}).close()
    assert "0 rows" in answer(path)
    assert json.loads(answer(path, "--json"))["to_s"] is None
    with pytest.raises(UserError, match="holds no rows"):
        answer(path, "--csv", tmp_path / "run.csv")


def test_a_stretch_is_shown_and_exported_by_the_log_s_time(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    summary = json.loads(answer(log, "--json", "--from", 0.3, "--to", "0.6"))
    assert (summary["rows"], summary["from_s"], summary["to_s"]) == (300, 0.3, 0.599)
    answer(log, "--from", 0.3, "--to", 0.6, "--csv", tmp_path / "a.csv")
    with (tmp_path / "a.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert (table[0]["time_s"], table[-1]["time_s"], len(table)) == ("0.3", "0.599", 300)
    drawn = []

    def keep(sketch: Sketch, _metadata: Mapping[str, Any], path: Path, *_: object) -> None:
        drawn.append(sketch.time)
        path.touch()

    monkeypatch.setattr("haptic_wall.controller.report.run.plot_run", keep)
    answer(log, "--from", 0.3, "--to", 0.6, "--plot", tmp_path / "a.png")
    assert (drawn[0][0], drawn[0][-1]) == pytest.approx((0.3, 0.599))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--from", "-1"], "--from: found -1, wanted a number from 0"),
        (["--to", "nan"], "--to: found nan, wanted a number"),
        (["--from", "2", "--to", "1"], "--to: found 1, wanted more than --from, which is 2"),
        (["--from", "5"], "holds no rows in that stretch"),
    ],
)
def test_a_stretch_that_is_none_is_refused(
    log: Path, cli: Cli, arguments: list[str], said: str
) -> None:
    assert said in cli.refused("log", log, *arguments)


@pytest.mark.parametrize("option", ["--csv", "--plot"])
def test_an_export_that_is_interrupted_leaves_nothing(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, option: str
) -> None:
    target = tmp_path / "out.png"
    words = [str(log), "--from", "0.1", option, str(target)]
    assert CliRunner().invoke(command, words).exit_code == 0
    before = target.read_bytes()
    seen = []

    def interrupted(*arguments: object) -> NoReturn:
        path = next(given for given in arguments if isinstance(given, Path))
        path.write_bytes(b"half")
        seen.append(path)
        raise KeyboardInterrupt

    for place in ("logs.csv_export.write_csv", "report.run.plot_log"):
        monkeypatch.setattr(f"haptic_wall.controller.{place}", interrupted)
    assert CliRunner().invoke(command, [*words, "--force"]).exit_code
    assert seen
    assert target.read_bytes() == before
    assert set(tmp_path.iterdir()) == {target, log}


LOSES: tuple[str, ...] = ("servo.faults=drop:p=0.3,at=2.0",)
OSCILLATES: tuple[str, ...] = (
    *("wall.side=both", "servo.hand=none", "servo.kick=0.05", "servo.coulomb=0"),
    *("servo.delay=0.006", "model.delay=0.002"),
)


@pytest.mark.whole
@pytest.mark.parametrize(
    ("sets", "duration", "begins"),
    [
        (LOSES, 1.3, "the guard allows"),
        (OSCILLATES, 3.0, "the wall has"),
    ],
)
def test_report_and_log_give_one_reason_with_the_commanded_number_and_the_schedule(
    cli: Cli, tmp_path: Path, sets: Sequence[str], duration: float, begins: str
) -> None:
    """Also where lost replies, or an alarm, have reduced the wall."""
    path = tmp_path / "a.hwlog"
    sets = ["loop.clock=simulated", "wall.stiffness=1e6", "safety.max_loss=0.9", *sets]
    run = ["run", "emulated-ideal", *(f"--set={each}" for each in sets), "--no-plot"]
    report = cli.json(*run, "--duration", duration, "--log", path)
    reasons, now = report["guard"]["reasons"], report["guard"]["commanded"]["stiffness"]
    assert reasons[0].startswith(f"{begins} {now:.4g} ")
    text = " ".join(report_text(report, brief=True).split())
    assert f"wall {now:.4g} N·m/rad of 1e+06 requested" in text
    assert f" why {reasons[0]} " in text and " cycles, immediate: " in report_text(report)
    assert cli.json("log", path)["report"]["guard"] == report["guard"]
    assert f" why {reasons[0]} why " in " ".join(cli("log", path).out.split())
