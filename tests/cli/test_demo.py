"""``demo``: Ctrl-C ends all of it, and its lesson says what theory says."""

from __future__ import annotations

import os
import re
import signal
import time
from contextlib import suppress
from importlib.resources import files
from pathlib import Path

import pytest

from haptic_wall.controller.cli import demo
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from haptic_wall.controller.theory.boundary import chain_peak
from haptic_wall.controller.theory.chain import one_mass
from tests.cases import whole_only
from tests.support.program import started, wait_for


def members(session: int) -> list[int]:
    """The processes of a session."""
    found = []
    for each in Path("/proc").iterdir():
        if each.name.isdigit():
            with suppress(OSError):
                fields = (each / "stat").read_text().rpartition(")")[2].split()
                if int(fields[3]) == session and fields[0] != "Z":
                    found.append(int(each.name))
    return found


@pytest.mark.whole
@pytest.mark.realtime
@pytest.mark.parametrize("wait_s", [whole_only(0.8), 1.5])
def test_ctrl_c_while_it_starts_ends_all_of_it(tmp_path: Path, wait_s: float) -> None:
    with started("demo", env={**os.environ, "TMPDIR": str(tmp_path)}) as child:
        time.sleep(wait_s)
        os.killpg(child.pid, signal.SIGINT)
        _, said = child.communicate(timeout=30.0)
        wait_for(lambda: not members(child.pid), "the end of all", 10.0)
    assert child.returncode == 130
    assert said.strip() == ""
    assert list(tmp_path.iterdir()) == []


def test_the_lesson_says_what_theory_says() -> None:
    text = (files("haptic_wall.controller.live") / "page" / "lesson.js").read_text()
    config = load_config("simulated", demo.SERVO).config
    servo = config.belief().inertia.low, config.belief().damping.low
    delay, period = config.belief().delay.high, config.period_s
    limit = float(critical_stiffness(*servo, 0.02, period, delay))
    late = float(critical_stiffness(*servo, 0.02, period, delay + 3 * period))
    ceiling = float(max_virtual_damping(*servo, period, delay))
    best = chain_peak(one_mass(*servo)[0], period, delay)
    stiffest, there = best.stiffness.item(), best.virtual_damping.item()
    for number in (limit, late, stiffest, there, ceiling):
        assert f"{number:.3g}" in text
    found = re.findall(r"(\w+): wall\(([\d.]+), ([\d.]+)", text)
    walls = {name: (float(stiffness), float(damping)) for name, stiffness, damping in found}
    assert walls["soft"][0] < 0.5 * limit < walls["prompt"][0] < 0.8 * limit
    assert late < walls["late"][0] < limit < walls["stiff"][0] < stiffest
    assert walls["damped"] == (walls["stiff"][0], float(f"{there:.3g}"))
    assert walls["too_much"][1] > ceiling and walls["far"][0] > 3.0 * limit
    assert f"wall.stiffness={walls['soft'][0]}" in demo.SERVO
