"""``haptic-wall detect`` on logs of ours and on anybody's CSV."""

import math
from pathlib import Path

import numpy as np
import pytest

from haptic_wall.controller.cli.detect import OWN
from tests.support.program import Cli, call

pytestmark = pytest.mark.usefixtures("undrawn")

STEP = math.tau / 4096
DECEIVED = (
    "loop.clock=simulated",
    "wall.side=both",
    "servo.hand=none",
    "servo.kick=0.05",
    "servo.coulomb=0",
    "servo.delay=0.006",
    "model.delay=0.002",
    "wall.damping=0",
    "safety.on_oscillation=report",
)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("detect")
    path = folder / "a.hwlog"
    sets = [word for text in DECEIVED for word in ("--set", text)]
    assert call("run", "simulated", *sets, "--duration", 4, "--no-plot", "--log", path) == 0
    return path


def test_a_log_says_what_the_run_saw(log: Path, tmp_path: Path, cli: Cli) -> None:
    own = cli.json("detect", log)
    assert own["state"] == "growing" and 0.0 < own["first_alarm_s"] < 3.0
    assert own["notes"] == [OWN]
    seen = cli.json("detect", log, "--delay", 0.006, "--plot", tmp_path / "d.png")
    assert seen["state"] == "growing"
    assert seen["frequency_hz"] == pytest.approx(math.sqrt(3.743 / 0.011951) / math.tau, rel=0.03)
    # K L = b + 2 m s with the true delay of 6 ms and half a period
    growth = (3.743 * 6.5e-3 - 0.011692) / (2 * 0.011951)
    assert own["growth_per_s"] == pytest.approx(growth, rel=0.1)
    assert seen["growth_per_s"] == pytest.approx(growth, rel=0.1)
    assert 0.0 <= seen["first_alarm_s"] < 3.0
    assert (tmp_path / "d.png").read_bytes().startswith(b"\x89PNG")


def test_its_csv_says_the_same(log: Path, tmp_path: Path, cli: Cli) -> None:
    csv = tmp_path / "a.csv"
    assert cli("log", log, "--csv", csv).status == 0
    servo = ("--inertia", 0.011951, "--damping", 0.011692, "--delay", 0.006)
    seen = cli.json("detect", csv, *servo)
    assert seen["state"] == "growing"
    assert seen["frequency_hz"] == pytest.approx(2.817, rel=0.03)


def test_a_hand_that_pushes_a_stable_wall_is_quiet(tmp_path: Path, cli: Cli) -> None:
    times = np.arange(0.0, 10.0, 1e-3)
    positions = np.round(0.1 * np.sin(math.tau * 1.3 * times) / STEP) * STEP
    rows = [
        f"{t!r},{x!r},{-8.0 * x!r}" for t, x in zip(times.tolist(), positions.tolist(), strict=True)
    ]
    path = tmp_path / "hand.csv"
    path.write_text("\n".join(["time_s,position_rad,torque_nm", *rows]))
    seen = cli.json("detect", path, "--inertia", 0.012, "--damping", 0.012, "--coulomb", 0.05)
    assert seen["state"] == "quiet"
    assert seen["first_alarm_s"] is None
