"""One command from an unknown servo to a verdict: what it measures, keeps, and says of failures."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

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
from tests.support.program import Cli, call
from tests.typed import not_none

SIMULATED = ("commission", "simulated", "--set=loop.clock=simulated")
REAL = ("commission", "xm430-w350", "--set=servo.port=/dev/null")
"""A real servo, whose port is none"""
PNG = b"\x89PNG\r\n\x1a\n"
"""How one begins"""
SWEPT = (PlanePoint(0.0, 3), PlanePoint(0.09, 3), PlanePoint(0.18, 3))
"""Points that are measured in a few trials"""


@pytest.fixture(scope="module")
def commissioned(
    whole_experiment: None,  # noqa: ARG001 - leaves it out
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """The folder of a whole commissioning of the simulated servo, with fewer points."""
    folder = tmp_path_factory.mktemp("commission") / "made"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(steps, "short_sweep", lambda _config: SWEPT)
        assert call(*SIMULATED, "--out", folder) == 0
    return folder


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
    limit = report["verdict"]["best"]["binding"]
    assert f"of the limit {limit}, " in shown and "config.yaml" in shown


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


class Played:
    """Steps that find something without moving, or end as the test asks.

    Attributes:
        called: Names of the steps that were taken.
        ends: What a step raises.
        partly: What it has measured until then.
    """

    def __init__(self) -> None:
        self.called: list[Step] = []
        self.ends: dict[Step, BaseException] = {}
        self.partly: dict[str, Any] = {}

    def run(self, name: Step, bench: StepContext) -> StepResult:
        self.called.append(name)
        if name in self.ends:
            bench.partly.update(self.partly)
            raise self.ends[name]
        return StepResult(DATA[name](bench))


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> Played:
    made = Played()
    for name in DATA:
        monkeypatch.setitem(steps.RUN, name, partial(made.run, name))
    # The plan has tests of its own, and takes most of the time.
    monkeypatch.setattr(plan, "short_sweep", lambda _config: (PlanePoint(0.0, 3),))
    return made


def states(report: Mapping[str, Any]) -> dict[str, str]:
    return {step["step"]: step["state"] for step in report["steps"]}


@pytest.mark.usefixtures("played")
def test_a_run_commands_what_the_verdict_says(cli: Cli, tmp_path: Path) -> None:
    report = cli.json(*SIMULATED, "--out", tmp_path)
    for case in ("plain", "best"):
        promised = report["verdict"][case]["commanded"]
        sets = ["--set=wall.stiffness=1e6", f"--set=wall.damping={promised['damping']}"]
        words = ["--duration=0.05", "--no-plot", "--log", tmp_path / f"{case}.hwlog"]
        guard = cli.json("run", tmp_path / "config.yaml", *sets, *words)["guard"]
        assert guard["commanded"] == pytest.approx(promised, rel=1e-6)
        assert guard["binding"] == report["verdict"][case]["binding"]


def test_an_earlier_commissioning_is_replaced_by_force_alone(
    played: Played, cli: Cli, tmp_path: Path
) -> None:
    cli.json(*SIMULATED, "--out", tmp_path)
    before = (tmp_path / "config.yaml").read_text()
    words = [*SIMULATED, "--set=servo.inertia=0.02", "--out", tmp_path]
    assert "--force" in cli.refused(*words)
    assert (tmp_path / "config.yaml").read_text() == before
    cli.json(*words, "--force")
    assert played.called == ["identify", "sweep", "identify", "sweep"]


def test_without_a_model_nothing_goes_on(played: Played, cli: Cli, tmp_path: Path) -> None:
    error = UnidentifiableError("the servo does not move: see that the shaft is not blocked")
    played.ends["identify"] = error
    report = cli.json(*SIMULATED, "--out", tmp_path, status=4)
    assert played.called == ["identify"]
    assert states(report) == {"doctor": "skipped", "identify": "failed", "sweep": "skipped"}
    assert report["verdict"]["basis"] == "believed" and report["config"] is None
    assert not (tmp_path / "config.yaml").exists()
    said = " ".join((tmp_path / "report.txt").read_text().split())
    assert "see that the shaft is not blocked" in said and said.startswith("NOT MEASURED")
    assert "pictures" not in said


@pytest.mark.parametrize(
    ("step", "error", "status"),
    [
        ("identify", ServoLostError("it answers no more"), 4),
        ("identify", ExperimentTrippedError(Trip.HARDWARE_ERROR, "hot"), 3),
        ("sweep", ExperimentTrippedError(Trip.OVERSPEED, "too fast"), 3),
    ],
)
def test_nothing_moves_after_a_step_that_failed_and_what_was_done_stays(
    played: Played, cli: Cli, tmp_path: Path, step: Step, error: Exception, status: int
) -> None:
    played.ends[step] = error
    report = cli.json(*SIMULATED, "--out", tmp_path, status=status)
    assert played.called == ["identify", "sweep"][: 1 + (step == "sweep")]
    assert states(report)[step] == "failed"
    if step == "sweep":
        assert states(report)["identify"] == "done"
    else:
        assert report["steps"][-1]["step"] == "sweep"
        assert report["steps"][-1]["reason"] == "identify ended the commissioning"


POINT = {
    "virtual_damping": 0.0,
    "delay_steps": 0,
    "delay_s": 0.0002,
    "kick_rad": 0.01,
    "measured": 30.0,
    "uncertainty": 1.0,
    "exact": 25.0,
    "reason": None,
}


@pytest.mark.parametrize(
    ("error", "points", "said"),
    [
        (KeyboardInterrupt(), [], "sweep: interrupted"),
        (
            ExperimentInterruptedError("interrupted", advice="1 of 6 points are kept"),
            [POINT],
            "sweep: interrupted: 1 of 6 points are kept",
        ),
    ],
)
def test_what_was_done_before_an_interrupt_is_kept(
    played: Played,
    cli: Cli,
    tmp_path: Path,
    error: BaseException,
    points: list[dict[str, Any]],
    said: str,
) -> None:
    played.ends["sweep"] = error
    played.partly = {"points": points} if points else {}
    report = cli.json(*SIMULATED, "--out", tmp_path, status=130)
    assert report["interrupted"]
    assert states(report)["sweep"] == "interrupted"
    text = " ".join((tmp_path / "report.txt").read_text().split())
    assert said in text
    assert ("of 1 measured points" in text) == bool(points)
    assert ("no point of the boundary was measured" in text) != bool(points)
    assert text.startswith(f"INCOMPLETE, without {'the rest of ' * bool(points)}sweep: ")
    model = load_config(str(tmp_path / "config.yaml")).config.model
    assert not_none(model.inertia).value == 0.012
    assert (tmp_path / "report.txt").exists()


def test_a_real_servo_does_not_move_without_a_yes(played: Played, cli: Cli, tmp_path: Path) -> None:
    told = cli.refused(*REAL, "--out", tmp_path)
    for what in ("--yes", "0.3 rad", "4.1 N·m", "about a minute"):
        assert what in told
    assert (played.called, list(tmp_path.iterdir())) == ([], [])


def test_what_is_fatal_ends_it_with_the_fix_before_anything_moves(
    played: Played, cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fix = "clear bit 0 of Drive Mode (10)"
    check = {"name": "direction", "ok": False, "found": "reverse", "wanted": "normal", "fix": fix}
    wrong = {"checks": [{**check, "fixable": True}], "reached": True, "fatal": ["direction"]}
    monkeypatch.setitem(steps.RUN, "doctor", lambda _bench: StepResult(wrong))
    report = cli.json(*REAL, "--yes", "--out", tmp_path, status=1)
    assert played.called == []
    assert fix in report["steps"][0]["reason"]
    assert fix in " ".join((tmp_path / "report.txt").read_text().split())


@pytest.mark.parametrize("command", ["acceptance", "commission", "identify"])
def test_a_port_that_is_not_there_is_refused_before_any_work(
    cli: Cli, tmp_path: Path, command: str
) -> None:
    answer = cli(
        command, "xm430-w350", "--set=servo.port=/no/tty", "--yes", "--out", tmp_path / "x"
    )
    assert answer.status == 4
    assert answer.err.startswith("haptic-wall: Port /no/tty does not exist")
    assert not list(tmp_path.iterdir())


@pytest.mark.whole
def test_a_port_that_is_none_is_found_by_the_real_doctor(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    played = Played()
    for name in ("identify", "sweep"):
        monkeypatch.setitem(steps.RUN, name, partial(played.run, name))
    report = cli.json(*REAL, "--yes", "--out", tmp_path, status=4)
    assert played.called == []
    assert "port" in report["steps"][0]["reason"]
