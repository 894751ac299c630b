"""``haptic-wall zwidth`` shows what a servo can render: by theory and by the guard."""

from pathlib import Path

import numpy as np
import pytest

from haptic_wall.controller.experiments import zwidth
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from tests.support.program import Cli

pytestmark = pytest.mark.usefixtures("undrawn")

SIMULATED = ("simulated", "--set", "loop.clock=simulated")
PLAIN = (*SIMULATED, "--set", "servo.coulomb=0", "--set", "servo.counts_per_rev=0")


@pytest.fixture(autouse=True)
def fewer(monkeypatch: pytest.MonkeyPatch, wholly: bool) -> None:
    """A curve has fewer points, unless whole experiments are played."""
    if not wholly:
        monkeypatch.setattr(zwidth, "_POINTS", 4)


def test_the_curves_are_those_of_theory_and_guard(tmp_path: Path, cli: Cli) -> None:
    report = cli.json("zwidth", *PLAIN, "--velocity-samples=1,3", "--out", tmp_path / "here")
    labels = [width["label"] for width in report["widths"]]
    assert labels == ["N 1", "N 3", "N 1, lowpass 100 Hz q 0.7"]
    assert (tmp_path / "here" / "zwidth.png").exists()
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
    assert filtered["side"] == "both"
    assert filtered["peak"]["guard"]["stiffness"] > 0.0
