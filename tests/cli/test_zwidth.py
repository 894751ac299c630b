"""``haptic-wall zwidth`` shows what a servo can render: by theory, by the guard, and measured."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.experiments import zwidth
from haptic_wall.controller.experiments.testbed import Testbed
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from tests.cli.caller import Cli, call

pytestmark = pytest.mark.usefixtures("undrawn")

SIMULATED = ("simulated", "--set", "loop.clock=simulated")
PLAIN = (*SIMULATED, "--set", "servo.coulomb=0", "--set", "servo.counts_per_rev=0")
ONE = "--velocity-samples=1"
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(autouse=True)
def fewer(monkeypatch: pytest.MonkeyPatch, wholly: bool) -> None:
    """A curve has fewer points, unless whole experiments are played."""
    if not wholly:
        monkeypatch.setattr(zwidth, "_POINTS", 4)


@pytest.fixture(scope="module")
def frictionless(
    whole_experiment: None,  # noqa: ARG001 - leaves it out
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Path, dict[str, Any]]:
    """The measured Z-width of a servo without friction, so that theory is exact."""
    folder = tmp_path_factory.mktemp("zwidth") / "here"
    assert call("zwidth", *PLAIN, "--velocity-samples=1,3", "--out", folder) == 0
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


def test_the_same_command_keeps_what_was_measured(
    frictionless: tuple[Path, dict[str, Any]], monkeypatch: pytest.MonkeyPatch, cli: Cli
) -> None:
    folder, report = frictionless

    def forbidden(*_: object, **__: object) -> None:
        raise AssertionError

    monkeypatch.setattr(Testbed, "play", forbidden)
    again = cli.json("zwidth", *PLAIN, "--velocity-samples=1,3", "--out", folder)
    assert [w["measured"] for w in again["widths"]] == [w["measured"] for w in report["widths"]]


def test_a_length_of_no_sample_is_refused_in_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = (*SIMULATED, "--measure=none", "--velocity-samples=0")
    assert call("zwidth", *given, "--out", tmp_path / "out") == 2
    said = capsys.readouterr().err
    assert "--velocity-samples: found 0, wanted a whole number from 1" in said


def test_ctrl_c_ends_it_and_says_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(zwidth, "sweep", lambda *_, **__: False)
    assert call("zwidth", *SIMULATED, ONE, "--measure=own", "--out", tmp_path / "out") == 130
    assert f"--out {tmp_path / 'out'} continues" in capsys.readouterr().err
