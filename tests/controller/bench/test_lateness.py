"""The section on lateness: its arithmetic, who is missing, and one turn of the real loops."""

import os
from importlib.metadata import PackageNotFoundError
from typing import NoReturn

import numpy as np
import pytest

from haptic_wall.controller.bench import cyclictest, lateness
from haptic_wall.controller.runtime.realtime import pick_cores
from tests.typed import not_none

SETTINGS = [
    {"name": "scheduler", "wanted": "SCHED_FIFO 80", "found": "refused: no", "ok": False,
     "fix": "sudo"},
]  # fmt: skip


@pytest.fixture
def stubs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Turns as given by name, a round each, for clients that start no process."""
    rounds = {
        "program": [[1.0] * 99 + [10.0], [1.0] * 98 + [30.0] * 2, [1.0] * 98 + [8.0] * 2],
        "cyclictest": [[5.0] * 98 + [20.0] * 2, [5.0] * 98 + [10.0] * 2, [5.0] * 98 + [16.0] * 2],
    }
    turns = {name: iter(each) for name, each in rounds.items()}

    def turn(name: str) -> lateness.Turn:
        late = next(turns[name], None) if name in turns else [60.0] * 100
        return lateness.Turn(np.array(late), 1000.0, SETTINGS)

    monkeypatch.setattr(lateness, "_ROUNDS", 3)
    monkeypatch.setattr(lateness, "_limiter", lambda _core: turn("limiter"))
    monkeypatch.setattr(lateness, "_program", lambda _core: turn("program"))
    monkeypatch.setattr(lateness, "_cyclictest", lambda *_: turn("cyclictest"))
    monkeypatch.setattr(lateness, "version", lambda _: "1.2.0")
    monkeypatch.setattr(cyclictest, "installed", lambda: "/usr/bin/cyclictest")
    monkeypatch.setattr(cyclictest, "lateness_us", lambda *_: np.zeros(10))


@pytest.mark.usefixtures("stubs")
def test_figures_are_medians_of_rounds_and_the_ratio_is_of_the_same_round() -> None:
    section = lateness.measure()
    rows = {row.name: row for row in section.rows}
    assert rows["cyclictest, lateness, p50"].value == 5.0
    assert rows["cyclictest, lateness, p99"].value == 16.0
    assert rows["haptic-wall run, lateness, p99"].value == 8.0  # of 1, 30 and 8
    ratio = rows["haptic-wall run: p99 of lateness over cyclictest's"]
    assert ratio.value == 0.5  # of 1/20, 30/10 and 8/16
    assert ratio.low == pytest.approx((0.05 + 0.5) / 2)
    assert ratio.high == pytest.approx((0.5 + 3.0) / 2)
    assert any("scheduler: refused: no" in note for note in section.notes)
    assert any("cyclictest -a" in note for note in section.notes)


@pytest.mark.usefixtures("stubs")
def test_whoever_is_missing_is_named_and_the_rest_is_measured(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def none(_name: object) -> NoReturn:
        raise PackageNotFoundError

    monkeypatch.setattr(cyclictest, "installed", lambda: None)
    monkeypatch.setattr(lateness, "version", none)
    section = lateness.measure()
    names = {row.name for row in section.rows}
    assert not [name for name in names if "cyclictest" in name or "loop-rate" in name]
    assert "haptic-wall run, rate delivered of 1000 Hz asked" in names
    assert any("install rt-tests" in note for note in section.notes)
    assert any("'.[bench]' in the clone" in note for note in section.notes)


@pytest.mark.whole
@pytest.mark.realtime
def test_the_real_loops_tell_every_wake_up_and_the_process_gets_its_cores_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(lateness, "_TICKS", 50)
    cores = os.sched_getaffinity(0)
    core, _ = pick_cores()
    pytest.importorskip("loop_rate_limiters")
    for turn in (lateness._limiter(core), lateness._program(core)):
        # A wake-up a tick: what a busy machine has skipped has none, and lowers the rate.
        assert 0 < turn.late_us.size <= 51
        assert turn.late_us.size >= 25 or not_none(turn.rate_hz) < 900.0
        assert turn.late_us.min() >= 0.0
    assert os.sched_getaffinity(0) == cores
