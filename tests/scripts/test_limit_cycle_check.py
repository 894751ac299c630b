"""The tables of the page are what is computed, and the simulation tells fates apart."""

import math

import pytest

from haptic_wall.controller.theory.cycles import (
    Backlash,
    LimitCycle,
    Quantisation,
    Saturation,
    limit_cycles,
)
from scripts.studies import limit_cycle_check
from scripts.studies.limit_cycle_check import STUDY, Setting, settled, wall
from scripts.study import found, usual
from tests.scripts.computed import stale


def test_the_tables_are_what_is_computed(thorough: bool) -> None:
    if thorough:
        assert stale(STUDY, ["spread"]) == [], "run scripts/study limit_cycle_check"


@pytest.mark.whole
def test_a_table_has_a_row_for_each_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limit_cycle_check, "MOST", 200)
    worth, missed, _ = STUDY.parts
    for part, cases in ((worth, limit_cycle_check.CASES), (missed, limit_cycle_check.SOFTER)):
        rows = list(part.lines(found(part, usual(STUDY, walls=2))))
        assert [row.split(" | ")[0] for row in rows[2:]] == [f"| {name}" for name in cases]
        assert len({row.count("|") for row in rows}) == 1


@pytest.fixture(autouse=True)
def little_time(monkeypatch: pytest.MonkeyPatch, thorough: bool) -> None:
    if not thorough:
        monkeypatch.setattr(limit_cycle_check, "LEAST", 5_000)
        monkeypatch.setattr(limit_cycle_check, "MOST", 25_000)


@pytest.mark.whole
def test_with_damping_a_saturated_wall_has_several_cycles() -> None:
    setting, effect = Setting(0.002, 0.0, 0.2, 1.5), Saturation(1.0)
    (cycle,) = limit_cycles(*wall(setting), effect)
    found = settled(effect, [(setting, cycle, start) for start in (0.05, 0.07, 1.0, 3.1)])
    periods = [1e3 / (each.frequency * cycle.frequency) for each in found]
    assert len({round(each) for each in periods}) == 4
    assert max(each.amplitude for each in found) > 5.0


def test_rest_and_endless_growth_are_told_apart() -> None:
    for effect, share, start, amplitude in (
        (Backlash(1e-3), 0.5, 1e-2, 0.0),
        (Backlash(1e-3), 2.0, 1.0, math.inf),
        (Quantisation(1e-3), 0.3, 3.0, 0.0),
    ):
        begun = [(Setting(0.02, 1.0, 0.0, share), LimitCycle(1e-2, 20.0, stable=True), start)]
        assert settled(effect, begun)[0].amplitude == amplitude
