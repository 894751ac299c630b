"""One command from an unknown servo to a verdict: what it measures, keeps, and says of failures."""

import base64
import gc
import json
import re
from collections.abc import Callable, Mapping
from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, NoReturn

import pytest

from haptic_wall.controller.cli.main import main
from haptic_wall.controller.experiments.commission import plan, steps
from haptic_wall.controller.experiments.commission.outcome import Step
from haptic_wall.controller.experiments.commission.sequence import run_steps
from haptic_wall.controller.experiments.commission.steps import StepContext, StepResult
from haptic_wall.controller.experiments.commission.store import CommissionStore, settings_of
from haptic_wall.controller.experiments.identify.bench import UnidentifiableError
from haptic_wall.controller.experiments.sweep.plan import PlanePoint
from haptic_wall.controller.experiments.sweep.sweep import sweep
from haptic_wall.controller.experiments.testbed import (
    ExperimentInterruptedError,
    ExperimentTrippedError,
)
from haptic_wall.controller.report.commission import picture
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.errors import ServoLostError
from tests.typed import not_none, status_of

ROOT = Path(__file__).parents[4]
SIMULATED = ("simulated", "--set=loop.clock=simulated")
OUTPUT = ROOT / "tests" / "data" / "commissioned.txt"
"""Output of a commissioning of the simulated servo"""
PNG = b"\x89PNG\r\n\x1a\n"
"""How one begins"""
SWEPT = (PlanePoint(0.0, 3), PlanePoint(0.09, 3), PlanePoint(0.18, 3))
"""Points that are measured in a few trials"""


def call(*words: object) -> int:
    try:
        return main([str(word) for word in words])
    except SystemExit as ended:
        return status_of(ended)
    finally:
        gc.enable()  # a run switches it off


ORDINARY = (
    "--set=servo.static_friction=0.113",
    "--set=servo.cogging=0.03",
    "--set=servo.cogging_phase=0.7",
    "--set=servo.gravity=0.1",
    "--set=servo.gravity_angle=0.6",
)
"""A servo that sticks and cogs, with a weight on it"""


def commission(folder: Path, *sets: str) -> None:
    """Take all steps on the simulated servo, with fewer points, in this process alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(steps, "short_sweep", lambda _config: SWEPT)
        patch.setattr(steps, "sweep", partial(sweep, workers=1))
        patch.setattr(steps, "BURSTS", 3)
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


def test_an_ordinary_servo_is_commissioned_to_the_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], thorough: bool
) -> None:
    if not thorough:
        pytest.skip("a minute; --thorough runs it")
    folder = tmp_path / "made"
    commission(folder, *ORDINARY)
    status, report = report_of(folder, capsys)
    assert (status, report["status"]) == (0, "complete")
    assert abs(report["agreement"]["delay"]["device"]["periods"]) < 0.2
    page = (folder / "report.html").read_text()
    assert page.count("data:image/png") == len(list(folder.glob("*.png"))) == 5
    for name, truth in (("inertia", 0.011951), ("damping", 0.011692)):
        each = report["verdict"]["model"][name]
        assert each["low"] <= truth <= each["high"]
    for misfit in (
        "Cogging: an amplitude of 0.03",
        "A torque of at most 0.1 N·m depends on the angle",
    ):
        assert misfit in page


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


def test_a_rerun_measures_nothing_again_and_says_the_same(
    commissioned: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing_moves(monkeypatch)
    before = (commissioned / "identify.json").read_text()
    status, first = report_of(commissioned, capsys)
    assert status == 0 and first["complete"]
    assert report_of(commissioned, capsys) == (0, first)
    assert (commissioned / "identify.json").read_text() == before


def test_a_run_commands_what_the_verdict_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    steps_taken(monkeypatch, {"nothing": None})
    _, report = report_of(tmp_path, capsys)
    for case in ("plain", "best"):
        promised = report["verdict"][case]["commanded"]
        words = ["run", tmp_path / "config.yaml", "--duration=0.05", "--json", "--no-plot"]
        words += ["--set=wall.stiffness=1e6", f"--set=wall.damping={promised['damping']}"]
        words += ["--log", tmp_path / "run.hwlog"]
        assert call(*words) == 0
        guard = json.loads(capsys.readouterr().out)["guard"]
        assert guard["commanded"] == pytest.approx(promised, rel=1e-6)
        assert guard["binding"] == report["verdict"][case]["binding"]


def test_the_truth_lies_within_the_bounds_that_are_written(commissioned: Path) -> None:
    config = load_config(str(commissioned / "config.yaml")).config
    for name in ("inertia", "damping", "coulomb", "delay"):
        believed = getattr(config.model, name)
        assert believed.low <= getattr(config.servo, name) <= believed.high, name


def test_theory_and_measurement_are_found_to_agree(
    commissioned: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, report = report_of(commissioned, capsys)
    found = report["agreement"]
    assert [point["agree"] for point in found["boundary"]] == [True] * len(SWEPT)
    assert found["delay"]["device"]["agree"]
    for point, swept in zip(found["boundary"], report["sweep"]["points"], strict=True):
        # The sweep predicts it by another way: the onset's amplitude over a grid of stiffnesses.
        assert point["expected"] == pytest.approx(swept["predicted_with_friction"], rel=2e-3)


class Page(HTMLParser):
    """What a page shows, and whether each of its elements is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.images: list[dict[str, str | None]] = []
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "img":
            self.images.append(dict(attrs))
        elif tag != "meta":
            self.open.append(tag)
        assert not {"href", "data-src"} & dict(attrs).keys()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def test_the_page_is_one_file_with_its_pictures_in_it(
    commissioned: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, report = report_of(commissioned, capsys)
    text = (commissioned / "report.html").read_text()
    page = Page(text)
    assert page.open == []
    assert len(page.images) == 5
    for image in page.images:
        head, _, data = not_none(image["src"]).partition(",")
        assert head == "data:image/png;base64" and image["alt"]
        assert base64.b64decode(data, validate=True).startswith(b"\x89PNG\r\n")
    assert "grid-template" not in text  # pictures side by side cannot be read
    assert not re.search(r"https?://|@import|url\(", text)
    shown = " ".join(" ".join(page.words).split())
    assert f"{report['verdict']['best']['commanded']['stiffness']:.3g} N·m/rad" in shown
    assert "torque constant" in shown and "config.yaml" in shown


def test_other_settings_are_refused_in_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    steps_taken(monkeypatch, {"nothing": None})
    report_of(tmp_path, capsys)
    words = [*SIMULATED, "--set=servo.inertia=0.02"]
    assert call("commission", *words, "--out", tmp_path) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "other settings" in line and "--fresh" in line
    assert (tmp_path / "identify.json").exists()


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
    bench.store.keep_config(text)
    return {
        **{name: {"value": value, "stderr": 0.01 * value} for name, value in MODEL.items()},
        "torque_unit": "commanded",
        "backlash": None,
        "warnings": [],
        "config_text": text,
    }


def delay_data(_bench: object) -> dict[str, Any]:
    device = {"value": 0.0002, "stderr": 1e-5}
    return {
        "parts": {"inserted": 0.0, "age": {"median": 0.0, "guard": 0.0}, "device": device},
        "points": [{"inserted": 0.0, "recovered": None}],
    }


def rendered_data(_bench: object) -> dict[str, Any]:
    wall = {"stiffness": 8.0, "damping": 0.02}
    return {"commanded": wall, "rows": [], "notes": []}


DATA: dict[Step, Callable[[StepContext], dict[str, Any]]] = {
    "doctor": lambda _bench: {"checks": [], "fatal": [], "reached": True},
    "identify": identify_data,
    "delay": delay_data,
    "rendered": rendered_data,
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
    # What is planned and drawn has tests of its own, and takes most of the time.
    monkeypatch.setattr(plan, "short_sweep", lambda _config: (PlanePoint(0.0, 3),))
    monkeypatch.setattr(picture, "draw_allowed", lambda _q, _r, path: path.write_bytes(PNG))
    return called if ends != {} else [*DATA]


def states(report: Mapping[str, Any]) -> dict[str, str]:
    return {step["step"]: step["state"] for step in report["steps"]}


def test_without_a_model_only_what_needs_none_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    error = UnidentifiableError("the servo does not move: see that the shaft is not blocked")
    called = steps_taken(monkeypatch, {"identify": error})
    status, report = report_of(tmp_path, capsys)
    assert status == 4
    assert called == ["identify", "delay"]
    assert states(report) == {
        "doctor": "skipped",
        "identify": "failed",
        "delay": "done",
        "rendered": "skipped",
        "sweep": "skipped",
    }
    assert report["verdict"]["basis"] == "believed" and report["config"] is None
    assert not (tmp_path / "config.yaml").exists()
    page = (tmp_path / "report.html").read_text()
    assert "see that the shaft is not blocked" in page and "not complete" in page


def test_a_trip_ends_its_step_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    trip = ExperimentTrippedError(Trip.OVERSPEED, "too fast")
    called = steps_taken(monkeypatch, {"delay": trip})
    status, report = report_of(tmp_path, capsys)
    assert status == 3
    assert states(report)["delay"] == "failed" and states(report)["sweep"] == "done"
    assert called[-1] == "sweep"
    # What failed is tried again, what is done is not.
    again = steps_taken(monkeypatch, {"nothing": None})
    assert report_of(tmp_path, capsys)[0] == 0
    assert again == ["delay"]


@pytest.mark.parametrize(
    "error",
    [ServoLostError("it answers no more"), ExperimentTrippedError(Trip.HARDWARE_ERROR, "hot")],
)
def test_nothing_moves_after_a_servo_was_lost(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    error: Exception,
) -> None:
    called = steps_taken(monkeypatch, {"delay": error})
    status, report = report_of(tmp_path, capsys)
    assert status in (3, 4)
    assert called == ["identify", "delay"]
    assert states(report)["sweep"] == "skipped"
    assert (tmp_path / "config.yaml").exists(), "what was identified is kept"


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ExperimentInterruptedError("by a person")])
def test_what_is_interrupted_is_kept_and_resumed(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
) -> None:
    steps_taken(monkeypatch, {"delay": error})
    status, report = report_of(tmp_path, capsys)
    assert status == 130 and report["interrupted"]
    assert states(report)["delay"] == "not taken"
    assert not_none(load_config(str(tmp_path / "config.yaml")).config.model.inertia).value == 0.012
    assert (tmp_path / "report.html").exists()
    called = steps_taken(monkeypatch, {"nothing": None})
    assert report_of(tmp_path, capsys)[0] == 0
    assert called == ["delay", "rendered", "sweep"]


def test_an_interrupted_commissioning_is_headlined_incomplete(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    steps_taken(monkeypatch, {"rendered": KeyboardInterrupt()})
    assert call("commission", *SIMULATED, "--out", tmp_path) == 130
    said = " ".join(capsys.readouterr().out.split())
    assert said.startswith("INCOMPLETE, without rendered, sweep: simulated can hold a wall of")
    assert "INCOMPLETE, without rendered" in (tmp_path / "report.html").read_text()
    steps_taken(monkeypatch, {"nothing": None})
    status, report = report_of(tmp_path, capsys)
    assert status == 0 and report["status"] == "complete"


def test_a_servo_that_was_not_identified_is_headlined_not_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    steps_taken(monkeypatch, {"identify": UnidentifiableError("stuck")})
    assert call("commission", *SIMULATED, "--out", tmp_path) == 4
    said = " ".join(capsys.readouterr().out.split())
    assert said.startswith("NOT MEASURED: simulated was not identified; by the belief of its")


@pytest.mark.parametrize("there", [False, True])
def test_where_nothing_was_measured_no_folder_is_left(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, there: bool
) -> None:
    """Of a folder that was there before, what was in it."""
    folder = tmp_path / "new"
    if there:
        folder.mkdir()
        (folder / "mine.txt").write_text("mine")
    steps_taken(monkeypatch, {"identify": KeyboardInterrupt()})
    status, report = report_of(folder, capsys)
    assert status == 130
    assert (report["status"], report["report"]) == ("not measured", None)
    assert [path.name for path in tmp_path.rglob("*")] == (["new", "mine.txt"] if there else [])
    assert call("commission", *SIMULATED, "--out", folder) == 130
    assert "nothing was measured, so nothing is left in" in capsys.readouterr().out


def test_an_interruption_leaves_what_an_earlier_commissioning_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    steps_taken(monkeypatch, {"nothing": None})
    report_of(tmp_path, capsys)
    before = sorted(path.name for path in tmp_path.iterdir())
    steps_taken(monkeypatch, {"identify": KeyboardInterrupt()})
    assert report_of(tmp_path, capsys, *SIMULATED, "--set=wall.stiffness=3", "--fresh")[0] == 130
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_a_step_is_taken_anew_when_the_model_is_another(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A delay that was measured beside a belief is measured again beside what is identified."""
    steps_taken(monkeypatch, {"identify": UnidentifiableError("stuck")})
    report_of(tmp_path, capsys)
    called = steps_taken(monkeypatch, {"nothing": None})
    assert report_of(tmp_path, capsys)[0] == 0
    assert called == ["identify", "delay", "rendered", "sweep"]


@pytest.mark.whole
def test_another_model_undoes_what_was_measured_beside_the_one_before(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else it would pass for complete, and a servo that is asked nothing would move."""
    steps_taken(monkeypatch, {"nothing": None})
    report_of(tmp_path, capsys, *REAL, "--yes")
    (tmp_path / "identify.json").unlink()
    steps_taken(monkeypatch, {"delay": KeyboardInterrupt()})
    assert report_of(tmp_path, capsys, *REAL, "--yes")[0] == 130
    called = steps_taken(monkeypatch, {"nothing": None})
    assert call("commission", *REAL, "--out", tmp_path) == 2
    assert "--yes" in capsys.readouterr().err
    assert called == []


def test_an_interruption_takes_nothing_of_what_was_measured_from_the_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    steps_taken(monkeypatch, {"delay": KeyboardInterrupt()})
    report_of(tmp_path, capsys, *REAL, "--yes")
    steps_taken(monkeypatch, {"doctor": KeyboardInterrupt()})
    status, report = report_of(tmp_path, capsys, *REAL, "--yes")
    assert status == 130
    assert states(report)["identify"] == "done"
    assert report["config"] is not None
    assert "the servo was not identified" not in (tmp_path / "report.html").read_text()


def test_fresh_begins_anew(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    steps_taken(monkeypatch, {"nothing": None})
    report_of(tmp_path, capsys)
    called = steps_taken(monkeypatch, {"nothing": None})
    words = [*SIMULATED, "--set=wall.stiffness=3", "--fresh"]
    assert report_of(tmp_path, capsys, *words)[0] == 0
    assert called == ["identify", "delay", "rendered", "sweep"]


def test_a_configuration_of_somebody_else_is_not_written_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "config.yaml"
    mine.write_text("servo: {inertia: 0.01, torque_limit: 4}\nloop: {clock: simulated}\n")
    before = mine.read_text()
    assert call("commission", *SIMULATED, "--out", tmp_path) == 2
    assert call("commission", mine, "--out", tmp_path) == 2
    assert call("commission", *SIMULATED, "--out", tmp_path, "--fresh") == 2
    assert "config.yaml" in capsys.readouterr().err
    assert mine.read_text() == before


def test_a_configuration_that_was_edited_since_stays_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    steps_taken(monkeypatch, {"nothing": None})
    report_of(tmp_path, capsys)
    config = tmp_path / "config.yaml"
    written = config.read_text()
    config.write_text("# stiffer on Tuesdays\n" + written)
    assert call("commission", *SIMULATED, "--out", tmp_path) == 0
    assert "config.yaml was edited, so it is not replaced" in capsys.readouterr().err
    assert config.read_text().startswith("# stiffer on Tuesdays\n")
    config.unlink()
    assert call("commission", *SIMULATED, "--out", tmp_path) == 0
    assert "edited" not in capsys.readouterr().err
    assert config.read_text() == written


def test_a_folder_is_wanted(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("commission", *SIMULATED) == 2
    assert "--out" in capsys.readouterr().err


# A real servo, of which only the port is missing

REAL = ("xm430-w350", "--set=servo.port=/nowhere/ttyUSB0")


def test_a_real_servo_does_not_move_without_a_yes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing_moves(monkeypatch)
    assert call("commission", *REAL, "--out", tmp_path) == 2
    told = capsys.readouterr().err
    assert "--yes" in told
    for what in ("0.3 rad", "4.1 N·m", "about a minute", "110 s"):
        assert what in told
    assert list(tmp_path.iterdir()) == []


def doctor_data(name: str, **more: object) -> dict[str, Any]:
    check = {"name": name, "ok": False, "found": "reverse", "wanted": "normal", "fixable": True}
    return {"checks": [{**check, "fix": "clear bit 0 of Drive Mode (10)"}], "reached": True, **more}


def test_what_is_fatal_ends_it_with_the_fix_before_anything_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    called = steps_taken(monkeypatch, {"nothing": None})
    wrong = doctor_data("direction", fatal=["direction"])
    monkeypatch.setitem(steps.RUN, "doctor", lambda _bench: StepResult(wrong))
    status, report = report_of(tmp_path, capsys, *REAL, "--yes")
    assert status == 1
    assert called == []
    assert "clear bit 0 of Drive Mode" in report["steps"][0]["reason"]
    assert "clear bit 0 of Drive Mode" in (tmp_path / "report.html").read_text()


def test_a_port_that_is_not_there_is_found_by_the_real_doctor(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    real = steps.RUN["doctor"]
    called = steps_taken(monkeypatch, {"nothing": None})
    monkeypatch.setitem(steps.RUN, "doctor", real)
    status, report = report_of(tmp_path, capsys, *REAL, "--yes")
    assert status == 4
    assert called == []
    assert "port" in report["steps"][0]["reason"]


def test_what_costs_only_stiffness_is_told_and_does_not_end_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    called = steps_taken(monkeypatch, {"nothing": None})
    found = doctor_data("return delay", fatal=[])
    monkeypatch.setitem(steps.RUN, "doctor", lambda _: StepResult(found))
    status, _ = report_of(tmp_path, capsys, *REAL, "--yes")
    assert status == 0
    assert called[-1] == "sweep"
    assert "return delay" in (tmp_path / "report.html").read_text()


@pytest.mark.whole
def test_who_moves_a_servo_again_looks_at_it_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    steps_taken(monkeypatch, {"sweep": KeyboardInterrupt()})
    assert report_of(tmp_path, capsys, *REAL, "--yes")[0] == 130
    called = steps_taken(monkeypatch, {"nothing": None})
    assert report_of(tmp_path, capsys, *REAL, "--yes")[0] == 0
    assert called == ["doctor", "sweep"]


def test_the_plan_moves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing_moves(monkeypatch)
    assert call("commission", *SIMULATED, "--plan", "--json") == 0
    plan = json.loads(capsys.readouterr().out)
    assert len(plan["steps"]) == 5 and plan["seconds"] > 60
    assert list(tmp_path.iterdir()) == []


def test_the_plan_says_what_its_folder_has_already_and_leaves_it_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def planned(*words: object) -> str:
        assert call("commission", *SIMULATED, "--plan", *words) == 0
        return capsys.readouterr().out

    steps_taken(monkeypatch, {"delay": KeyboardInterrupt()})
    new, begun = tmp_path / "new", tmp_path / "begun"
    assert "kept" not in planned("--out", new) and not new.exists()
    report_of(begun, capsys)
    before = {path: path.read_bytes() for path in begun.iterdir() if path.is_file()}
    assert "kept from before: identify" in planned("--out", begun)
    assert "kept" not in planned("--out", begun, "--fresh")
    assert json.loads(planned("--out", begun, "--json"))["kept"] == ["identify"]
    assert {path: path.read_bytes() for path in begun.iterdir() if path.is_file()} == before


def test_the_plan_refuses_a_folder_that_the_commissioning_would_refuse(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "config.yaml").write_text("mine")
    assert call("commission", *SIMULATED, "--plan", "--out", tmp_path) == 2
    assert "config.yaml" in capsys.readouterr().err


def test_results_are_kept_as_each_is_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A power cut in a later step loses nothing: the files are there before it begins."""

    def looks(_bench: object) -> StepResult:
        assert (tmp_path / "config.yaml").exists() and (tmp_path / "identify.json").exists()
        return StepResult(delay_data(_bench))

    steps_taken(monkeypatch, {"nothing": None})
    monkeypatch.setitem(steps.RUN, "delay", looks)
    config = load_config(SIMULATED[0], ["loop.clock=simulated"]).config
    store = CommissionStore(tmp_path, settings_of(config, 0.6), "it", json.dumps, False)
    assert run_steps(StepContext(config, "it", 0.6, store, lambda _text: None)).exit_status == 0


def fails(*_given: object) -> NoReturn:
    raise RuntimeError("no font")


def test_a_picture_that_cannot_be_drawn_costs_nothing_that_was_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    steps_taken(monkeypatch, {"nothing": None})

    def kept(_found: object, name: str, path: Path) -> None:
        assert json.loads((tmp_path / "delay.json").read_text())["state"] == "done"
        assert name == "simulated" and path.parent == tmp_path
        fails()

    monkeypatch.setitem(steps.RUN, "delay", lambda bench: StepResult(delay_data(bench), (None,)))
    monkeypatch.setitem(picture.PLOTS, "delay", kept)
    monkeypatch.setattr(picture, "draw_allowed", lambda _q, _r, path: fails(path))
    assert call("commission", *SIMULATED, "--out", tmp_path, "--json") == 0
    answer, told = capsys.readouterr()
    assert told.count("no font") == 2 and "delay: its picture could not be drawn" in told
    taken = {step["step"]: step for step in json.loads(answer)["steps"]}
    assert taken["delay"]["state"] == "done" and taken["delay"]["picture"] is None
    assert "<img" not in (tmp_path / "report.html").read_text()


def test_an_interruption_of_a_drawing_costs_nothing_that_was_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupts(*_given: object) -> NoReturn:
        raise KeyboardInterrupt

    steps_taken(monkeypatch, {"nothing": None})
    monkeypatch.setitem(steps.RUN, "delay", lambda bench: StepResult(delay_data(bench), (None,)))
    monkeypatch.setitem(picture.PLOTS, "delay", interrupts)
    status, report = report_of(tmp_path, capsys)
    assert status == 130
    assert states(report)["delay"] == "done" and states(report)["rendered"] == "not taken"


def test_the_page_shows_lines_of_the_output() -> None:
    page = (ROOT / "docs" / "commissioning.md").read_text()
    shown = not_none(re.search(r"^```text\n(.*?)^```", page, re.S | re.M))[1]
    assert set(shown.splitlines()) <= set(OUTPUT.read_text().splitlines())


def test_the_output_is_as_kept(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    thorough: bool,
) -> None:
    """The whole of it, and its figures to the digits that are the same on every machine."""
    if not thorough:
        pytest.skip("a minute; --thorough runs it")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    shown = OUTPUT.read_text()
    assert call("commission", *SIMULATED, "--out", "commissioned") == 0
    said = capsys.readouterr().out
    number = r"[-+]?\d+\.?\d*(?:e[-+]\d+)?"
    assert re.sub(number, "#", said).split() == re.sub(number, "#", shown).split()
    pairs = zip(re.findall(number, said), re.findall(number, shown), strict=True)
    assert all(float(a) == pytest.approx(float(b), rel=0.3, abs=0.03) for a, b in pairs)
