"""``haptic-wall identify --record`` on recorded motions of known and of real servos."""

import os
import signal
import time as clock
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.controller.experiments.recorded.made import Truth, rounded, swing, table
from tests.support.program import LAUNCHER, Cli, started

pytestmark = pytest.mark.usefixtures("undrawn")

REAL = Path(__file__).parents[2] / "docs" / "examples" / "xl330-pendulum"
PENDULUM = ("--pendulum-mass", "0.49", "--pendulum-length", "0.1")


def drop(truth: Truth, *, seconds: float = 2.4, begin: float = 0.9) -> dict[str, np.ndarray]:
    random = np.random.default_rng(4)
    time = np.cumsum(0.004 * (1.0 + 0.3 * random.random(int(seconds / 0.0046))))
    free = np.zeros(time.shape)
    position = rounded(swing(truth, time, begin))
    return {"time_s": time, "position_rad": position, "torque_enabled": free}


def holds(answer: dict[str, Any], **truth: float) -> None:
    for name, true in truth.items():
        value, stderr = answer[name]["value"], answer[name]["stderr"]
        assert abs(value - true) < 2.0 * stderr, (name, value, stderr, true)


def test_a_drop_tells_inertia_and_friction(tmp_path: Path, cli: Cli) -> None:
    truth = Truth()
    path = tmp_path / "drop.csv"
    path.write_text(f"# by hand\n{table(drop(truth))}")
    answer = cli.json("identify", "--record", path, *PENDULUM, "--plot", tmp_path / "a.png")
    holds(answer, inertia=truth.inertia, damping=truth.damping, coulomb=truth.coulomb)
    assert answer["inertia"]["stderr"] < 0.15 * truth.inertia
    assert answer["delay"] is None
    assert answer["torque_gain"] is None
    assert answer["friction_model"] == "M1"
    assert answer["residual_rms_rad"] < 1.2 * answer["rounding_rad"]
    assert any("delay and torque gain cannot be determined" in note for note in answer["notes"])
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.whole
def test_a_known_torque_tells_delay_and_gain(tmp_path: Path, cli: Cli) -> None:
    truth = Truth()
    time = np.arange(0.0, 2.4, 0.006)
    torque = 0.25 * np.sin(4.0 * time) + 0.2 * np.sin(11.0 * time)
    columns = {
        "time_s": time,
        "position_rad": rounded(swing(truth, time, truth.hanging, torque)),
        "torque_nm": torque,
    }
    path = tmp_path / "driven.csv"
    path.write_text(table(columns))
    answer = cli.json("identify", "--record", path, *PENDULUM)
    holds(answer, inertia=truth.inertia, damping=truth.damping, coulomb=truth.coulomb)
    holds(answer, delay=truth.delay, torque_gain=truth.gain)

    path.write_text(table({**columns, "current_a": torque / 0.5}).replace("torque_nm", "other"))
    answer = cli.json("identify", "--record", path, *PENDULUM)
    assert answer["torque_gain"] is None
    holds(answer, torque_constant_nm_per_a=0.5 * truth.gain, coulomb=truth.coulomb)


@pytest.mark.whole
def test_a_real_drop(cli: Cli) -> None:
    answer = cli.json("identify", "--record", REAL / "kp100_lift_and_drop.csv", *PENDULUM)
    # a published fit of this model has 0.0017 to 0.0021 kg·m² and 0.0156 to 0.0206 N·m
    assert 0.0015 < answer["inertia"]["value"] < 0.0026
    assert 0.012 < answer["coulomb"]["value"] < 0.020
    assert 0.003 < answer["residual_rms_rad"] < 0.010
    assert answer["damping"]["stderr"] > 0.3 * answer["damping"]["value"]


def test_gaps_and_disorder_are_told(tmp_path: Path, cli: Cli) -> None:
    truth = Truth()
    columns = drop(truth)
    kept = np.ones(columns["time_s"].shape, dtype=bool)
    kept[150:210] = False
    columns = {name: values[kept] for name, values in columns.items()}
    columns["time_s"][40] = columns["time_s"][38]
    columns["position_rad"][[20, 21]] = np.nan
    path = tmp_path / "gap.csv"
    path.write_text(table(columns).replace("nan", ""))
    answer = cli.json("identify", "--record", path, *PENDULUM)
    holds(answer, inertia=truth.inertia, damping=truth.damping, coulomb=truth.coulomb)
    said = " ".join(answer["notes"])
    assert "nothing is known from" in said
    assert "2 rows have no position" in said
    assert "1 rows are left out: their time" in said


@pytest.mark.realtime
def test_an_interrupted_fit_ends_with_130(tmp_path: Path) -> None:
    path = REAL / "kp400_lift_and_drop.csv"
    words = ("identify", "--record", path, *PENDULUM, "--json")
    with started(*words, cwd=tmp_path, program=[LAUNCHER]) as run:
        clock.sleep(1.0)
        os.kill(run.pid, signal.SIGINT)
        run.communicate(timeout=30)
    assert run.returncode == 130
