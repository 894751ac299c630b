"""``haptic-wall acceptance``: two servos are measured and judged; one file is sent back."""

import json
import socket
import zipfile
from pathlib import Path
from typing import Any, NoReturn

import pytest

from haptic_wall.controller.cli.acceptance import _text
from haptic_wall.controller.experiments import acceptance
from haptic_wall.controller.experiments.commission import plan, steps
from haptic_wall.controller.experiments.commission.sequence import Ended
from haptic_wall.controller.experiments.commission.steps import StepOutcome
from haptic_wall.controller.experiments.sweep.plan import PlanePoint
from haptic_wall.controller.experiments.testbed import ExperimentInterruptedError
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.errors import ServoLostError
from tests.support.program import Cli, call

pytestmark = pytest.mark.usefixtures("undrawn")

SIMULATED = ("simulated", "--set=loop.clock=simulated")
EMULATED = ("emulated-ideal", "--set=loop.clock=simulated")
SWEPT = (PlanePoint(0.0, 3), PlanePoint(0.09, 3))
USER, HOST = "jane-roe-7", "janes-laptop"


def named(patch: pytest.MonkeyPatch, home: Path) -> None:
    """Give user, machine and home folder names that must not be sent."""
    patch.setattr(Path, "home", lambda: home)
    patch.setattr("getpass.getuser", lambda: USER)
    patch.setattr(socket, "gethostname", lambda: f"{HOST}.example.org")
    patch.setattr("platform.node", lambda: HOST)


@pytest.fixture(scope="module")
def accepted(
    whole_experiment: None,  # noqa: ARG001 - leaves it out
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """The folder of a whole acceptance of the simulated servo, in the home of somebody."""
    home = tmp_path_factory.mktemp("home") / USER
    folder = home / "bench" / "accepted"
    home.mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan, "short_sweep", lambda _config: SWEPT)
        named(patch, home)
        assert call("acceptance", *SIMULATED, "--yes", "--out", folder) == 0
    return folder


@pytest.mark.thorough
def test_an_emulated_servo_is_accepted_to_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Down to the bytes: each step through the driver, on a bus in memory."""
    monkeypatch.setattr(plan, "short_sweep", lambda _config: SWEPT[:1])
    assert call("acceptance", *EMULATED, "--yes", "--out", tmp_path / "out") == 0
    report = report_of(tmp_path / "out")
    assert [s["step"] for s in report["steps"] if s["state"] != "done"] == ["doctor"]
    assert (tmp_path / "out" / "acceptance.zip").exists()


def report_of(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "acceptance.json").read_text())
    return found


def test_a_figure_that_holds_beside_its_bounds_has_the_digits_and_the_reason() -> None:
    config = load_config("simulated").config
    found = {"inertia": (0.01195, 0.0001), "delay": (5.8e-6, 4e-6)}
    data = {name: {"value": value, "stderr": error} for name, (value, error) in found.items()}
    ended = Ended({"identify": StepOutcome("identify", "done", data=data)}, config, False)
    rows = acceptance.rows(config, ended, ended)
    told = {row["name"]: row["note"] for row in rows}
    near = "within 2 standard errors"
    assert told == {"inertia": near, "delay of the servo": near}
    said = _text({"name": "mine", "headline": "", "rows": rows, "steps": [], "versions": {}})
    assert "predicted 0.011951; this servo 0.01195 ± 0.0001;" in said
    assert "predicted 0; this servo 5.8e-06 ± 4e-06;" in said


def test_the_steps_are_taken_and_most_predictions_hold(accepted: Path) -> None:
    report = report_of(accepted)
    states = {step["step"]: step["state"] for step in report["steps"]}
    assert states == {
        "doctor": "skipped",  # there is no bus in real time
        **dict.fromkeys(("identify", "sweep"), "done"),
    }
    verdicts = {row["name"]: row["verdict"] for row in report["rows"]}
    limits = [name for name in verdicts if name.startswith("critical stiffness")]
    assert len(limits) == len(SWEPT)
    assert {verdicts[name] for name in limits} == {"holds"}


def test_the_bundle_names_nobody(accepted: Path) -> None:
    secret = [USER, HOST, str(accepted.parent), str(accepted.parents[1])]
    with zipfile.ZipFile(accepted / "acceptance.zip") as packed:
        names = packed.namelist()
        for name in names:
            content = packed.read(name)
            assert [word for word in secret if word.encode() in content] == [], name
        assert packed.testzip() is None
    assert {"acceptance.json", "report.txt"} <= {*names}
    assert any(name.startswith("measured/logs/") and ".hwlog.csv" in name for name in names)
    assert any(name.startswith("emulated/") for name in names)
    assert "python" in report_of(accepted)["versions"]


def test_ctrl_c_keeps_what_is_done_and_writes_no_bundle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli
) -> None:
    def interrupted(*_: object, **__: object) -> NoReturn:
        raise ExperimentInterruptedError("interrupted")

    monkeypatch.setitem(steps.RUN, "identify", interrupted)
    answer = cli.json("acceptance", *SIMULATED, "--out", tmp_path / "out", status=130)
    assert answer["error"].startswith("interrupted: finished steps are in")
    assert answer["exit_status"] == 130
    assert not (tmp_path / "out" / "acceptance.zip").exists()


@pytest.mark.whole
def test_after_a_lost_servo_nothing_moves_and_the_bundle_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lost(_bench: object) -> NoReturn:
        raise ServoLostError("The servo is gone", advice="look at its cable.")

    monkeypatch.setitem(steps.RUN, "identify", lost)
    assert call("acceptance", *SIMULATED, "--out", tmp_path / "out") == 4
    report = report_of(tmp_path / "out")
    reasons = {step["step"]: step["reason"] for step in report["steps"]}
    assert "The servo is gone" in reasons["identify"]
    assert reasons["sweep"] == "identify ended the commissioning"
    assert (tmp_path / "out" / "acceptance.zip").exists()
