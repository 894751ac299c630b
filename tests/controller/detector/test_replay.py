"""The log of a run tells what the run told: the state and the first alarm, to the tick."""

from pathlib import Path
from typing import Any

import pytest

from tests.cases import sampled
from tests.support.program import Cli

BASE = ("loop.clock=simulated", "servo.hand=none", "servo.kick=0.05", "servo.coulomb=0")
DECEIVED = (*BASE, "wall.side=both", "servo.delay=0.006", "model.delay=0.002", "wall.damping=0")


def both(
    folder: Path, cli: Cli, *sets: str, status: int = 0
) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """The oscillation that a run reports, that of ``detect`` on its log, and the run's report."""
    words = [f"--set={text}" for text in sets]
    log = "--log", folder / "a.hwlog"
    ran = cli.json("run", "simulated", *words, "--duration=3", *log, "--no-plot", status=status)
    return ran["oscillation"], cli.json("detect", folder / "a.hwlog"), ran


@pytest.mark.parametrize(
    "more",
    sampled(
        [
            "safety.on_oscillation=trip",
            "safety.on_oscillation=report",
            "safety.on_oscillation=reduce",
            "safety.on_oscillation=reduce wall.side=above servo.hand=lean",
            "safety.on_oscillation=reduce servo.counts_per_rev=0 delay.steps=1",
            "safety.on_oscillation=reduce wall.passivity_control=true",
            "safety.on_oscillation=reduce servo.hand=push wall.reference=start",
            "servo.gravity=0.8 servo.gravity_angle=1.57 servo.kick=0.3",
        ],
        8,
    ),
)
def test_detect_on_the_log_says_what_the_run_said(tmp_path: Path, cli: Cli, more: str) -> None:
    status = 3 if "=trip" in more else 0
    seen, found, ran = both(tmp_path, cli, *DECEIVED, *more.split(), status=status)
    assert found["state"] == seen["state"]
    assert found["first_alarm_s"] == seen["first_alarm_s"]
    assert found["frequency_hz"] == seen["frequency_hz"]
    assert found["amplitude_rad"] == seen["amplitude_rad"]
    if ran["stop_reason"] == "trip:oscillation":
        last_s = (found["samples"] - 1) * found["period_s"]
        assert seen["first_alarm_s"] == pytest.approx(last_s), "the log holds the alarm's own row"


def test_a_hand_on_a_stable_wall_is_as_quiet_in_the_log(tmp_path: Path, cli: Cli) -> None:
    seen, found, _ = both(tmp_path, cli, "loop.clock=simulated")
    assert found["state"] == seen["state"] == "quiet"
    assert found["frequency_hz"] is found["amplitude_rad"] is found["growth_per_s"] is None


def test_with_other_values_it_is_judged_by_those(tmp_path: Path, cli: Cli) -> None:
    _, found, _ = both(tmp_path, cli, *DECEIVED, "safety.on_oscillation=report")
    judged = cli.json("detect", tmp_path / "a.hwlog", "--inertia=0.1")
    assert judged["known"]["inertia"] == pytest.approx(0.1)
    assert judged["first_alarm_s"] != found["first_alarm_s"]
