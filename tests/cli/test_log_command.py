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
from haptic_wall.controller.cli.text import brief_text, report_text
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.writer import LogWriter, append_end
from haptic_wall.controller.report.sketch import Sketch
from haptic_wall.controller.runtime.telemetry import FLAG_CONTACT, FLAG_WARM_UP, ROW
from haptic_wall.controller.settings.load import load_config
from tests.cli.caller import Cli

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


def test_summary_as_json(log: Path) -> None:
    summary = json.loads(answer(log, "--json"))
    assert summary["rows"] == 1001
    assert summary["duration_s"] == pytest.approx(1.0)
    assert summary["rate_hz"] == pytest.approx(1000.0)
    assert (summary["missed_ticks"], summary["failed_readings"]) == (3, 1)
    assert summary["position_rad"] == pytest.approx([-0.0997, 0.2])
    assert summary["metadata"]["config"]["wall"]["stiffness"] == 8.0


def test_summary_as_text(log: Path) -> None:
    text = answer(log)
    assert "simulated servo, wall above 0.0 rad, K 8.0 N·m/rad, B 0.02 N·m·s/rad requested" in text
    assert "1001 in 1 s: 1000 Hz" in text
    assert "3 missed ticks, 1 failed readings, 0 rows not recorded" in text


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


def test_a_log_without_rows_is_summarised_but_not_exported(tmp_path: Path) -> None:
    path = tmp_path / "empty.hwlog"
    LogWriter(path, {"name": "simulated", "program": "haptic-wall"}).close()
    assert "rows        none" in answer(path)
    assert json.loads(answer(path, "--json"))["duration_s"] is None
    with pytest.raises(UserError, match="holds no rows"):
        answer(path, "--csv", tmp_path / "run.csv")


def test_the_summary_tells_what_happened_and_how_it_ended(log: Path) -> None:
    text = answer(log)
    assert "on for 900 ticks, after 101 of warm-up; in contact for 66.7 % of them" in text
    assert "oscillation sustained, first at 0.5 s, for 20 ticks" in text
    assert "largest 60 µs at 0.7 s" in text
    assert "ended       not recorded in run.hwlog" in text
    append_end(log, {"stop_reason": "trip:overspeed", "message": "fast", "rows": 1011})
    assert "ended       BY A SAFETY TRIP: overspeed (fast)" in answer(log)
    summary = json.loads(answer(log, "--json"))
    assert (summary["stop_reason"], summary["guard"]) == ("trip:overspeed", None)
    assert summary["unrecorded_rows"] == 10


def test_the_summary_gives_the_reasons_and_notes_of_the_run(log: Path) -> None:
    guard, note = {"reasons": ["first", "then " * 40]}, "grant it: `sudo true`"
    append_end(log, {"stop_reason": "duration", "guard": guard, "warnings": [note]})
    text = " ".join(answer(log).split())
    assert f"why first why {'then ' * 40}note {note}" in text
    assert json.loads(answer(log, "--json"))["guard"] == guard


def test_a_stretch_is_shown_and_exported_by_the_log_s_time(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    summary = json.loads(answer(log, "--json", "--from", 0.3, "--to", "0.6"))
    assert (summary["rows"], summary["from_s"], summary["to_s"]) == (300, 0.3, 0.599)
    assert (summary["missed_ticks"], summary["unrecorded_rows"]) == (0, 0)
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
    text = " ".join(brief_text(report).split())
    assert f"wall {now:.4g} N·m/rad of 1e+06 requested" in text
    assert f" why {reasons[0]} " in text and " cycles, immediate: " in report_text(report)
    told = cli.json("log", path)
    assert told["guard"] == report["guard"]
    assert told["schedule"] == report["bus"]["schedule"] == "immediate"
    text = " ".join(cli("log", path).out.split())
    assert f" why {reasons[0]} why " in text and " schedule immediate " in text
