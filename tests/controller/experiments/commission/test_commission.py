"""One command from an unknown servo to a verdict: what it measures, keeps, and says of failures."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import pytest

from haptic_wall.controller.experiments.commission import plan, steps
from haptic_wall.controller.experiments.commission.steps import Step, StepContext, StepResult
from haptic_wall.controller.experiments.identify.bench import UnidentifiableError
from haptic_wall.controller.experiments.sweep.plan import PlanePoint
from haptic_wall.controller.experiments.testbed import (
    ExperimentInterruptedError,
    ExperimentTrippedError,
)
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.errors import ServoLostError
from tests.support.program import call
from tests.typed import not_none

ROOT = Path(__file__).parents[4]
SIMULATED = ("simulated", "--set=loop.clock=simulated")
OUTPUT = ROOT / "tests" / "data" / "commissioned.txt"
"""Output of a commissioning of the simulated servo"""
PNG = b"\x89PNG\r\n\x1a\n"
"""How one begins"""
SWEPT = (PlanePoint(0.0, 3), PlanePoint(0.09, 3), PlanePoint(0.18, 3))
"""Points that are measured in a few trials"""


def commission(folder: Path, *sets: str) -> None:
    """Take all steps on the simulated servo, with fewer points."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(steps, "short_sweep", lambda _config: SWEPT)
        assert call("commission", *SIMULATED, *sets, "--out", folder) == 0


@pytest.fixture(scope="module")
def commissioned(
    whole_experiment: None,  # noqa: ARG001 - leaves it out
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """The folder of a whole commissioning of the simulated servo."""
    folder = tmp_path_factory.mktemp("commission") / "made"
    commission(folder)
    return folder


def report_of(
    folder: Path, capsys: pytest.CaptureFixture[str], *words: object
) -> tuple[int, dict[str, Any]]:
    capsys.readouterr()
    status = call("commission", *(words or SIMULATED), "--out", folder, "--json")
    out = capsys.readouterr().out
    return status, json.loads(out, parse_constant=pytest.fail)


def called(name: str, _bench: StepContext) -> NoReturn:
    pytest.fail(name)


def nothing_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in steps_taken(monkeypatch, {}):
        monkeypatch.setitem(steps.RUN, name, partial(called, name))


def test_a_run_commands_what_the_verdict_says(desk: Desk) -> None:
    desk.take()
    _, report = desk.report()
    for case in ("plain", "best"):
        promised = report["verdict"][case]["commanded"]
        words = ["run", desk.folder / "config.yaml", "--duration=0.05", "--json", "--no-plot"]
        words += ["--set=wall.stiffness=1e6", f"--set=wall.damping={promised['damping']}"]
        words += ["--log", desk.folder / f"{case}.hwlog"]
        assert call(*words) == 0
        guard = json.loads(desk.capsys.readouterr().out)["guard"]
        assert guard["commanded"] == pytest.approx(promised, rel=1e-6)
        assert guard["binding"] == report["verdict"][case]["binding"]


def test_the_truth_lies_within_the_bounds_that_are_written(commissioned: Path) -> None:
    config = load_config(str(commissioned / "config.yaml")).config
    for name in ("inertia", "damping", "coulomb", "delay"):
        believed = getattr(config.model, name)
        assert believed.low <= getattr(config.servo, name) <= believed.high, name


def test_theory_and_measurement_are_found_to_agree(commissioned: Path) -> None:
    report = json.loads((commissioned / "commission.json").read_text())
    found = report["agreement"]
    assert [point["agree"] for point in found["boundary"]] == [True] * len(SWEPT)
    for point, swept in zip(found["boundary"], report["sweep"]["points"], strict=True):
        # By two ways: the damping of friction at the kick, and the onset over a grid.
        assert point["expected"] == pytest.approx(swept["predicted_with_friction"], rel=5e-3)


def test_the_text_stands_beside_the_pictures(commissioned: Path) -> None:
    report = json.loads((commissioned / "commission.json").read_text())
    for step in ("identify", "sweep"):
        assert (commissioned / f"{step}.png").read_bytes().startswith(PNG)
    shown = " ".join((commissioned / "report.txt").read_text().split())
    assert f"{report['verdict']['best']['commanded']['stiffness']:.3g} N·m/rad" in shown
    assert "torque constant" in shown and "config.yaml" in shown


def test_an_earlier_commissioning_is_replaced_by_force_alone(desk: Desk) -> None:
    called = desk.take()
    desk.report()
    before = (desk.folder / "config.yaml").read_text()
    words = [*SIMULATED, "--set=servo.inertia=0.02"]
    assert call("commission", *words, "--out", desk.folder) == 2
    assert "--force" in desk.capsys.readouterr().err
    assert (desk.folder / "config.yaml").read_text() == before
    assert desk.report(*words, "--force")[0] == 0
    assert called == ["identify", "sweep", "identify", "sweep"]


# With steps that move nothing

MODEL = {
    "inertia": 0.012,
    "damping": 0.0117,
    "coulomb": 0.09,
    "delay": 0.0002,
    "torque_gain": 1.0,
}


def identify_data(bench: StepContext) -> dict[str, Any]:
    raw = bench.config.model_dump(mode="json")
    raw["model"] = {k: {"value": v, "low": 0.9 * v, "high": 1.1 * v} for k, v in MODEL.items()}
    text = json.dumps(raw)  # JSON is YAML
    return {
        **{name: {"value": value, "stderr": 0.01 * value} for name, value in MODEL.items()},
        "torque_unit": "commanded",
        "backlash": None,
        "warnings": [],
        "sample_age_s": 0.0,
        "config_text": text,
    }


DATA: dict[Step, Callable[[StepContext], dict[str, Any]]] = {
    "doctor": lambda _bench: {"checks": [], "fatal": [], "reached": True},
    "identify": identify_data,
    "sweep": lambda _bench: {"points": []},
}


def steps_taken(
    monkeypatch: pytest.MonkeyPatch, ends: Mapping[str, BaseException | None]
) -> list[Step]:
    """Steps that find something without moving, or end as asked; the names of those called."""
    called: list[Step] = []

    def step(name: Step) -> Callable[[StepContext], StepResult]:
        def run(bench: StepContext) -> StepResult:
            called.append(name)
            if (error := ends.get(name)) is not None:
                raise error
            return StepResult(DATA[name](bench))

        return run

    for name in DATA:
        monkeypatch.setitem(steps.RUN, name, step(name))
    # The plan has tests of its own, and takes most of the time.
    monkeypatch.setattr(plan, "short_sweep", lambda _config: (PlanePoint(0.0, 3),))
    return called if ends != {} else [*DATA]


@dataclass
class Desk:
    """A folder, and who commissions into it with steps that move nothing."""

    folder: Path
    capsys: pytest.CaptureFixture[str]
    patch: pytest.MonkeyPatch

    def take(self, ends: Mapping[str, BaseException | None] | None = None) -> list[Step]:
        return steps_taken(self.patch, ends or {"nothing": None})

    def report(self, *words: object) -> tuple[int, dict[str, Any]]:
        return report_of(self.folder, self.capsys, *words)


@pytest.fixture
def desk(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Desk:
    return Desk(tmp_path, capsys, monkeypatch)


def states(report: Mapping[str, Any]) -> dict[str, str]:
    return {step["step"]: step["state"] for step in report["steps"]}


def test_without_a_model_nothing_goes_on(desk: Desk) -> None:
    error = UnidentifiableError("the servo does not move: see that the shaft is not blocked")
    called = desk.take({"identify": error})
    status, report = desk.report()
    assert status == 4
    assert called == ["identify"]
    assert states(report) == {"doctor": "skipped", "identify": "failed", "sweep": "skipped"}
    assert report["verdict"]["basis"] == "believed" and report["config"] is None
    assert not (desk.folder / "config.yaml").exists()
    said = " ".join((desk.folder / "report.txt").read_text().split())
    assert "see that the shaft is not blocked" in said and said.startswith("NOT MEASURED")


def test_a_trip_ends_its_step_alone(desk: Desk) -> None:
    trip = ExperimentTrippedError(Trip.OVERSPEED, "too fast")
    called = desk.take({"sweep": trip})
    status, report = desk.report()
    assert status == 3
    assert called == ["identify", "sweep"]
    assert states(report)["identify"] == "done" and states(report)["sweep"] == "failed"


@pytest.mark.parametrize(
    "error",
    [ServoLostError("it answers no more"), ExperimentTrippedError(Trip.HARDWARE_ERROR, "hot")],
)
def test_nothing_moves_after_a_servo_was_lost(desk: Desk, error: Exception) -> None:
    called = desk.take({"identify": error})
    status, report = desk.report()
    assert status in (3, 4)
    assert called == ["identify"]
    assert states(report)["sweep"] == "skipped"
    reason = next(step["reason"] for step in report["steps"] if step["step"] == "sweep")
    assert reason == "identify ended the commissioning"


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ExperimentInterruptedError("by a person")])
def test_what_was_done_before_an_interrupt_is_kept(desk: Desk, error: BaseException) -> None:
    desk.take({"sweep": error})
    status, report = desk.report()
    assert status == 130 and report["interrupted"]
    assert states(report)["sweep"] == "not taken"
    model = load_config(str(desk.folder / "config.yaml")).config.model
    assert not_none(model.inertia).value == 0.012
    assert (desk.folder / "report.txt").exists()


def test_a_configuration_of_somebody_else_is_not_written_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "config.yaml"
    mine.write_text("servo: {inertia: 0.01, torque_limit: 4}\nloop: {clock: simulated}\n")
    before = mine.read_text()
    assert call("commission", *SIMULATED, "--out", tmp_path) == 2
    assert call("commission", mine, "--out", tmp_path) == 2
    assert "config.yaml" in capsys.readouterr().err
    assert mine.read_text() == before


# A real servo, of which only the port is missing

REAL = ("xm430-w350", "--set=servo.port=/nowhere/ttyUSB0")


def test_a_real_servo_does_not_move_without_a_yes(desk: Desk) -> None:
    nothing_moves(desk.patch)
    assert call("commission", *REAL, "--out", desk.folder) == 2
    told = desk.capsys.readouterr().err
    assert "--yes" in told
    for what in ("0.3 rad", "4.1 N·m", "about a minute"):
        assert what in told
    assert list(desk.folder.iterdir()) == []


def doctor_data(name: str, **more: object) -> dict[str, Any]:
    check = {"name": name, "ok": False, "found": "reverse", "wanted": "normal", "fixable": True}
    return {"checks": [{**check, "fix": "clear bit 0 of Drive Mode (10)"}], "reached": True, **more}


def test_what_is_fatal_ends_it_with_the_fix_before_anything_moves(desk: Desk) -> None:
    called = desk.take()
    wrong = doctor_data("direction", fatal=["direction"])
    desk.patch.setitem(steps.RUN, "doctor", lambda _bench: StepResult(wrong))
    status, report = desk.report(*REAL, "--yes")
    assert status == 1
    assert called == []
    assert "clear bit 0 of Drive Mode" in report["steps"][0]["reason"]
    said = " ".join((desk.folder / "report.txt").read_text().split())
    assert "clear bit 0 of Drive Mode" in said


@pytest.mark.whole
def test_a_port_that_is_not_there_is_found_by_the_real_doctor(desk: Desk) -> None:
    real = steps.RUN["doctor"]
    called = desk.take()
    desk.patch.setitem(steps.RUN, "doctor", real)
    status, report = desk.report(*REAL, "--yes")
    assert status == 4
    assert called == []
    assert "port" in report["steps"][0]["reason"]


def test_the_page_shows_lines_of_the_output() -> None:
    page = (ROOT / "docs" / "how-to" / "commissioning.md").read_text()
    shown = not_none(re.search(r"^```text\n(.*?)^```", page, re.S | re.M))[1]
    assert set(shown.splitlines()) <= set(OUTPUT.read_text().splitlines())
