"""``haptic-wall acceptance``: two servos are measured and judged; one file is sent back."""

import json
import socket
import zipfile
from pathlib import Path
from typing import Any, NoReturn

import pytest

from haptic_wall.controller.experiments import acceptance
from haptic_wall.controller.experiments.commission import steps
from haptic_wall.controller.experiments.sweep.plan import PlanePoint
from haptic_wall.controller.experiments.testbed import (
    ExperimentInterruptedError,
)
from haptic_wall.hw.errors import ServoLostError
from tests.cli.caller import call

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


def quicker(patch: pytest.MonkeyPatch) -> None:
    """Measure fewer points."""
    patch.setattr(acceptance, "short_sweep", lambda _config: SWEPT)


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
        quicker(patch)
        named(patch, home)
        assert call("acceptance", *SIMULATED, "--yes", "--out", folder) == 0
    return folder


@pytest.mark.thorough
def test_an_emulated_servo_is_accepted_to_the_end(tmp_path: Path) -> None:
    """Down to the bytes: each step through the driver, on a bus in memory."""
    with pytest.MonkeyPatch.context() as patch:
        quicker(patch)
        patch.setattr(acceptance, "short_sweep", lambda _config: SWEPT[:1])
        assert call("acceptance", *EMULATED, "--yes", "--out", tmp_path / "out") == 0
    report = report_of(tmp_path / "out")
    assert [s["step"] for s in report["steps"] if s["state"] != "done"] == ["doctor"]
    assert (tmp_path / "out" / "acceptance.zip").exists()


def report_of(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "acceptance.json").read_text())
    return found


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


def test_an_earlier_acceptance_is_not_replaced(
    accepted: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (accepted / "acceptance.json").read_bytes()
    assert call("acceptance", *SIMULATED, "--yes", "--out", accepted) == 2
    assert "give --force to replace it" in capsys.readouterr().err
    assert (accepted / "acceptance.json").read_bytes() == before


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("simulated",), "--out: missing"),
        (
            ("simulated", "--set=wall.law=spring", "--out", "{out}"),
            "wall.law: found spring, wanted wall",
        ),
        (("xm430-w350", "--out", "{out}"), "give --yes when the shaft's way is free"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(
    words: tuple[str, ...], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("acceptance", *(word.format(out=tmp_path / "out") for word in words)) == 2
    assert told in capsys.readouterr().err
    assert not [*tmp_path.rglob("*.json")]


def test_ctrl_c_keeps_what_is_done_and_writes_no_bundle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> NoReturn:
        raise ExperimentInterruptedError("interrupted")

    monkeypatch.setitem(steps.RUN, "identify", interrupted)
    words = ("simulated", "--set=loop.clock=simulated", "--out", tmp_path / "out")
    assert call("acceptance", *words, "--json") == 130
    said = capsys.readouterr()
    answer = json.loads(said.out)
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
    words = ("simulated", "--set=loop.clock=simulated", "--out", tmp_path / "out")
    assert call("acceptance", *words) == 4
    report = report_of(tmp_path / "out")
    reasons = {step["step"]: step["reason"] for step in report["steps"]}
    assert "The servo is gone" in reasons["identify"]
    assert reasons["sweep"] == "identify ended the commissioning"
    assert (tmp_path / "out" / "acceptance.zip").exists()
