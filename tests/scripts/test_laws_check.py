"""The search for motion that lasts finds it where it is, and none on what the guard commands."""

from dataclasses import replace

import numpy as np
import pytest

from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.controller.theory.flexible import flexible_boundary
from scripts.sampled_laws import Kind, Law, Loads, Servos, lasting, moved
from scripts.studies import laws_check
from scripts.studies.laws_check import KINDS, STUDY, Block, block, shaped
from scripts.study import found, usual

DELTA, DELAY = 0.05, 1.5


def left(share: float, kind: Kind) -> float:
    """Energy that is left of ten motions with a law, at a share of the exact limit."""
    one, start = np.ones(10), np.linspace(-0.9, 0.9, 10)
    stiffness = share * critical_stiffness(1.0, DELTA, 0.0, 1.0, DELAY) * one
    table = shaped(np.tile([1.0, -1.0, -1.0, 1.0], (10, 1)), kind, True)
    servos = Servos(DELTA * one, stiffness, 0.0 * one, DELAY * one)
    motion = moved(Law(kind, 10, table), servos, start, 0.02 * start, 2000)
    return float(lasting(motion, 1e-7 * stiffness).max())


@pytest.mark.parametrize("kind", ["periodic", "bounded"])
def test_motion_decays_below_the_exact_limit_and_lasts_above(kind: Kind) -> None:
    assert left(0.8, kind) < 0.5
    assert left(1.2, kind) > 0.97


def test_two_masses_on_a_stiff_transmission_move_as_one() -> None:
    one, x = np.ones(5), np.linspace(-0.4, 0.4, 5)
    rigid = Servos(0.05 * one, 0.02 * one, 0.01 * one, 1.3 * one)
    loads = Loads(0.3 * one, 3.0 * one, 0.5 * one, np.array([0.0, 1.0, 0.0, 1.0, 0.0]), 0.0 * one)
    table = shaped(np.tile([1.0, -1.0, -1.0, 1.0], (5, 1)), "periodic", True)
    ends = [
        moved(Law("periodic", 5, table), servos, x, 0.03 * x, 200).energy
        for servos in (rigid, replace(rigid, loads=loads))
    ]
    assert ends[1] == pytest.approx(ends[0], rel=0.05)


def test_a_soft_transmission_lasts_above_its_own_limit_and_decays_below() -> None:
    share, rate, ratio = 0.4, 0.3, 0.02
    limit = flexible_boundary(
        1.0 - share, 0.01, share, 0.24 * rate**2, 0.48 * ratio * rate, 0.02, 1.0, 1.0
    ).stiffness
    one = np.ones(4)
    loads = Loads(share * one, rate * one, ratio * one, 0.0 * one, 0.01 * one)
    table = shaped(np.tile([1.0] * 4, (4, 1)), "bounded", False)
    for factor, lasts in ((0.8, False), (1.2, True)):
        servos = Servos(0.01 * one, factor * limit * one, 0.02 * one, one, loads)
        motion = moved(Law("bounded", 4, table), servos, 1e-3 * one, 0.0 * one, 3000)
        left = lasting(motion, 1e-12 * one)
        assert (left > 0.97).all() if lasts else (left < 0.9).all(), (factor, left)


@pytest.mark.parametrize("kind", KINDS)
def test_no_motion_lasts_on_what_the_guard_commands(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, few in (("LAWS", 20), ("STARTS", 3), ("CORNER_LAWS", 1), ("PERIODS", 1500)):
        monkeypatch.setattr(laws_check, name, few)
    monkeypatch.setattr(laws_check, "DELTA", (2e-2, 5e-2))
    monkeypatch.setattr(laws_check, "MULTIPLES", (1.0,))
    row = block(Block(kind, 1))
    assert row.lasting == 0
    assert row.back <= 1.001


def test_no_motion_lasts_on_two_masses(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes = ("FLEXIBLE_LAWS", 2), ("STARTS", 3), ("CORNER_LAWS", 1), ("PERIODS", 1500)
    for name, few in sizes:
        monkeypatch.setattr(laws_check, name, few)
    monkeypatch.setattr(laws_check, "DELTA", (2e-2, 5e-2))
    monkeypatch.setattr(laws_check, "MULTIPLES", (1.0,))
    case = Block("periodic", 1, flexible=True)
    row = block(case)
    assert (case.name, row.lasting) == ("periodic, two masses", 0)


def test_a_table_has_a_row_for_each_law(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, few in (("LAWS", 2), ("CORNER_LAWS", 1), ("PERIODS", 40), ("SEARCH_PERIODS", 40)):
        monkeypatch.setattr(laws_check, name, few)
    monkeypatch.setattr(laws_check, "SHARES", (0.8,))
    drawn, searched = STUDY.parts
    rows = list(drawn.lines(found(drawn, usual(STUDY, blocks=1, flexible=0))))
    assert [row.split(" | ")[0] for row in rows[2:]] == [f"| {kind}" for kind in KINDS]
    rows = list(searched.lines(found(searched, usual(STUDY, rounds=1, seeds=1))))
    assert len(rows) == 2 + 3
