"""``haptic-wall zwidth`` shows what a servo can render: by theory, by the guard, and measured."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.cli.main import main
from haptic_wall.controller.experiments.testbed import (
    ExperimentInterruptedError,
    ExperimentTrippedError,
    Testbed,
)
from haptic_wall.controller.experiments.zwidth import plane
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from tests.cli.caller import Cli
from tests.typed import status_of

pytestmark = pytest.mark.usefixtures("undrawn")

SIMULATED = ("simulated", "--set", "loop.clock=simulated")
PLAIN = (*SIMULATED, "--set", "servo.coulomb=0", "--set", "servo.counts_per_rev=0")
ONE = "--velocity-samples=1"
COMPUTED = (*SIMULATED, ONE, "--measure=none")
PNG = b"\x89PNG\r\n\x1a\n"


def call(*words: str | Path) -> int:
    try:
        return main([*map(str, ("zwidth", *words))])
    except SystemExit as ended:
        return status_of(ended)


@pytest.fixture(autouse=True)
def fewer(monkeypatch: pytest.MonkeyPatch, wholly: bool) -> None:
    """A curve has fewer points, unless whole experiments are played."""
    if not wholly:
        monkeypatch.setattr(plane, "_POINTS", 4)


@pytest.fixture(scope="module")
def frictionless(
    whole_experiment: None,  # noqa: ARG001 - leaves it out
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Path, dict[str, Any]]:
    """The measured Z-width of a servo without friction, so that theory is exact."""
    folder = tmp_path_factory.mktemp("zwidth") / "here"
    assert call(*PLAIN, "--velocity-samples=1,3", "--out", folder) == 0
    return folder, json.loads((folder / "zwidth.json").read_text())


def test_what_is_measured_is_what_theory_says(frictionless: tuple[Path, dict[str, Any]]) -> None:
    folder, report = frictionless
    labels = [width["label"] for width in report["widths"]]
    assert labels == ["N 1", "N 3", "N 1, lowpass 100 Hz q 0.7"]
    points = [point for width in report["widths"] for point in width["measured"]]
    good = [point for point in points if point["measured"] is not None]
    assert len(good) >= 7
    for point in good:
        assert point["measured"] == pytest.approx(point["exact"], rel=0.06)
    assert (folder / "zwidth.png").read_bytes().startswith(PNG)


def test_the_curves_are_those_of_theory_and_guard(
    frictionless: tuple[Path, dict[str, Any]],
) -> None:
    _, report = frictionless
    belief = load_config("simulated").config.belief()
    loop = (belief.inertia.value, belief.damping.value, 1e-3, 0.0)
    for width, n in zip(report["widths"][:2], (1, 3), strict=True):
        dampings = np.array([point["virtual_damping"] for point in width["curve"]])
        exact = np.array([point["exact"] for point in width["curve"]])
        assert width["max_virtual_damping"] == pytest.approx(
            float(max_virtual_damping(*loop, n)), rel=0.05
        )
        m, b, t, t_d = loop
        wanted = critical_stiffness(m, b, dampings, t, t_d, n)
        assert exact[dampings < 1.0] == pytest.approx(wanted[dampings < 1.0], rel=0.05)
        guard = [point["guard"] for point in width["curve"] if point["guard"] is not None]
        assert 0 < len(guard) < len(exact)
        assert all(k <= 0.8001 * e for k, e in zip(guard, exact, strict=False))
    filtered = report["widths"][2]
    assert all(point["guard"] is None for point in filtered["curve"])
    assert filtered["peak"]["guard_two_sided"]["stiffness"] > 0.0


def test_a_difference_over_more_samples_lowers_the_exact_limit(
    frictionless: tuple[Path, dict[str, Any]],
) -> None:
    peaks = [width["peak"]["exact"]["stiffness"] for width in frictionless[1]["widths"]]
    assert peaks[0] > 2.0 * peaks[1] > 2.0 * peaks[2]


def test_the_impedance_is_that_of_the_law_where_a_tap_excites_it(
    frictionless: tuple[Path, dict[str, Any]],
) -> None:
    found = frictionless[1]["impedance"]
    assert (found["torque"], found["reason"]) == ("sent", None)
    measured = [band for band in found["bands"] if band["stiffness"] is not None]
    assert len(measured) >= 6
    for band in measured:
        assert band["stiffness"] == pytest.approx(band["commanded_stiffness"], rel=0.05)
        off = 0.05 * band["commanded_damping"] + 4.0 * band["stderr"] / (
            math.tau * band["frequency_hz"]
        )
        assert band["damping"] == pytest.approx(band["commanded_damping"], abs=off)
        assert 0.5 <= band["coherence"] <= 1.0 and band["stderr"] >= 0.0
    assert found["bands"][-1]["stiffness"] is None  # no tap is so quick
    low = found["bands"][0]
    assert (low["commanded_stiffness"], low["commanded_damping"]) == pytest.approx(
        (8.0, 0.02), rel=0.01
    )


def test_the_same_command_keeps_what_was_measured(
    frictionless: tuple[Path, dict[str, Any]], monkeypatch: pytest.MonkeyPatch, cli: Cli
) -> None:
    folder, report = frictionless

    def forbidden(*_: object, **__: object) -> None:
        raise AssertionError

    monkeypatch.setattr(Testbed, "play", forbidden)
    again = cli.json("zwidth", *PLAIN, "--velocity-samples=1,3", "--out", folder)
    assert [w["measured"] for w in again["widths"]] == [w["measured"] for w in report["widths"]]


@pytest.mark.whole
def test_a_shaft_at_rest_is_not_excited_and_inserted_delay_shows(tmp_path: Path, cli: Cli) -> None:
    still, moved = tmp_path / "still.hwlog", tmp_path / "moved.hwlog"
    sets = ["--set", "loop.clock=simulated", "--set", "wall.side=both", "--set", "delay.steps=5"]
    for log, hand in ((still, "none"), (moved, "tap")):
        words = [
            "run",
            "simulated",
            *sets,
            f"--set=servo.hand={hand}",
            "--duration=10",
            "--no-plot",
        ]
        with pytest.raises(SystemExit, match="0"):
            main([*words, "--log", str(log)])
    found = cli.json("zwidth", *COMPUTED, "--log", still, "--out", tmp_path / "a")
    assert found["impedance"]["reason"].startswith("not excited")
    assert {band["stiffness"] for band in found["impedance"]["bands"]} == {None}
    found = cli.json("zwidth", *COMPUTED, "--log", moved, "--out", tmp_path / "b")
    ten = next(b for b in found["impedance"]["bands"] if b["frequency_hz"] == pytest.approx(10.0))
    k, b = found["impedance"]["stiffness"], found["impedance"]["virtual_damping"]
    w = math.tau * 10.0
    assert 0.0 < k < 8.0  # the guard counts the delay
    late = (k + 1j * w * b) * np.exp(-1j * w * 5e-3)
    assert ten["stiffness"] == pytest.approx(late.real, rel=0.05)
    assert ten["damping"] * w == pytest.approx(late.imag, abs=0.2)


def test_nothing_moves_without_a_measurement_and_a_real_servo_wants_a_log(
    tmp_path: Path, cli: Cli
) -> None:
    found = cli.json("zwidth", "xm430-w350", "--measure=none", "--out", tmp_path / "real")
    assert "--log" in found["impedance"]["reason"]
    assert "model.backlash 0" in found["widths"][-1]["reason"]
    assert found["widths"][0]["peak"]["guard"]["stiffness"] > 1.0
    assert not (tmp_path / "real" / "measured").exists() or not any(
        (tmp_path / "real" / "measured").iterdir()
    )


def test_a_trip_while_it_is_tapped_costs_the_impedance_only(
    tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    def tripped(*_: object) -> None:
        raise ExperimentTrippedError(Trip.OVERSPEED, "too fast")

    monkeypatch.setattr("haptic_wall.controller.experiments.zwidth.measured._tapped", tripped)
    monkeypatch.setattr(
        "haptic_wall.controller.experiments.zwidth.measured.sweep", lambda *_, **__: True
    )
    found = cli.json("zwidth", *SIMULATED, ONE, "--out", tmp_path / "out")
    assert found["impedance"]["reason"].endswith("too fast")
    assert found["widths"][0]["peak"]["exact"] is not None


def test_a_log_of_a_wall_that_never_acted_says_so(tmp_path: Path, cli: Cli) -> None:
    log = tmp_path / "away.hwlog"
    words = ["run", "simulated", "--set=loop.clock=simulated", "--set=servo.hand=none"]
    with pytest.raises(SystemExit, match="0"):
        main([*words, "--duration=1", "--no-plot", "--log", str(log)])
    found = cli.json("zwidth", *COMPUTED, "--log", log, "--out", tmp_path / "a")
    assert found["impedance"]["reason"] == "the log has no row in which the wall acted"
    assert found["impedance"]["stiffness"] == 8.0


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--velocity-samples=0",), "--velocity-samples: found 0, wanted a whole number from 1"),
        (("--log", "nowhere.hwlog"), "--log nowhere.hwlog: there is no such file"),
        (("--log", "{text}"), "is not a log of haptic-wall"),
        (("--log", "{detents}"), "found the law detents, wanted the log of a wall"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(
    words: tuple[str, ...], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, detents = tmp_path / "text.hwlog", tmp_path / "detents.hwlog"
    text.write_text("nothing")
    if "{detents}" in words:
        sets = ["--set=loop.clock=simulated", "--set=wall.law=detents", "--set=wall.count=12"]
        with pytest.raises(SystemExit, match="0"):
            main(["run", "simulated", *sets, "--duration=0.2", "--no-plot", "--log", str(detents)])
    given = [word.format(text=text, detents=detents) for word in words]
    assert call(*SIMULATED, "--measure=none", *given, "--out", tmp_path / "out") == 2
    assert told in capsys.readouterr().err


def test_ctrl_c_ends_it_and_says_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(
        "haptic_wall.controller.experiments.zwidth.measured.sweep", lambda *_, **__: False
    )
    assert call(*SIMULATED, ONE, "--out", tmp_path / "out") == 130
    assert f"--out {tmp_path / 'out'} continues" in capsys.readouterr().err


def test_the_guards_curve_is_what_a_run_commands(
    frictionless: tuple[Path, dict[str, Any]], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    curve = frictionless[1]["widths"][0]["curve"]
    point = curve[len([p for p in curve if p["guard"] is not None]) // 2]
    damping = f"wall.damping={point['virtual_damping']!r}"
    sets = ["--set", damping, "--set", "wall.stiffness=1e6", "--duration=0.1", "--no-plot"]
    capsys.readouterr()
    with pytest.raises(SystemExit, match="0"):
        main(["run", *PLAIN, *sets, "--json", "--log", str(tmp_path / "run.hwlog")])
    commanded = json.loads(capsys.readouterr().out)["guard"]["commanded"]
    assert commanded["stiffness"] == pytest.approx(point["guard"], rel=0.03)


def test_an_interruption_while_it_is_tapped_ends_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise ExperimentInterruptedError("interrupted")

    monkeypatch.setattr("haptic_wall.controller.experiments.zwidth.measured._tapped", interrupted)
    monkeypatch.setattr(
        "haptic_wall.controller.experiments.zwidth.measured.sweep", lambda *_, **__: True
    )
    assert call(*SIMULATED, ONE, "--out", tmp_path / "o") == 130
