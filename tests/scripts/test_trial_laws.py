"""Rows for the laws in the tables: what is drawn, and what is told of it."""

from dataclasses import replace

import numpy as np
import pytest

from haptic_wall.controller.settings.load import load_config
from scripts.studies.detector_table import STUDY
from scripts.study import usual
from scripts.trials.cases import PRESETS
from scripts.trials.draws import bench_of
from scripts.trials.laws import (
    HANDS,
    LAWS,
    LawTried,
    draw_beyond,
    draw_hand,
    draw_law,
    jobs,
    reaction_told,
    told,
)
from scripts.trials.verdicts import Answered, answered, goes_on_by_itself

RANDOM = 4


def outcome(*, alarm_s: float = 1.0, late_s: float = 0.0, after: float = 0.1) -> Answered:
    case = draw_beyond(PRESETS[0], "detents", np.random.default_rng(RANDOM))
    return Answered(
        case=case,
        in_time=late_s == 0.0,
        late_s=late_s,
        late_at_any_speed=False,
        never=False,
        trip=None,
        gave_up=False,
        unseen=False,
        alarm_s=alarm_s,
        at_alarm=0.1,
        after=after,
    )


@pytest.mark.parametrize("law", LAWS)
def test_every_law_is_drawn_with_numbers_that_a_configuration_takes(law: str) -> None:
    random = np.random.default_rng(RANDOM)
    drawn = {draw_law(law, random) for _ in range(5)}
    for sets in drawn:
        config = load_config("simulated", (*bench_of(PRESETS[0]).sets, *sets), runs=True).config
        assert config.law(0.0).name in (law, sets[0].partition("=")[2])
    assert len(drawn) == (1 if law in ("spring", "damper") else 5)


@pytest.mark.parametrize("hand", HANDS)
def test_a_hand_moves_the_shaft_of_a_law(hand: str) -> None:
    case = draw_hand(PRESETS[0], "friction", hand, np.random.default_rng(RANDOM))
    trial = replace(case, duration_s=2.0).run()
    assert np.ptp(trial.output) > 0.01
    assert trial.stiffness[-1] == pytest.approx(case.wall.stiffness)


def test_a_spring_far_beyond_its_limit_is_found_and_answered() -> None:
    random = np.random.default_rng(RANDOM)
    cases = (draw_beyond(PRESETS[1], "spring", random) for _ in range(20))
    case = next(case for case in cases if goes_on_by_itself(case))
    found = answered(case)
    assert found.alarm_s > 0.0
    assert not found.never


def test_the_tables_count_what_is_late_and_what_grows() -> None:
    results = [
        LawTried(PRESETS[0], "detents", [], 5, [outcome(), outcome(late_s=0.5)]),
        LawTried(PRESETS[1], "detents", [], 4, [outcome(after=0.3)]),
    ]
    made = told(results)
    line = next(line for line in made.lines if line.startswith("| detents | 9"))
    assert line.startswith("| detents | 9 | 3 | 2 of 3 (66.7 %") and "| 1: 0.50 s |" in line
    assert [what for what, _ in made.wrong] == ["late by 0.50 s"]
    reaction = reaction_told(results)
    assert [what for what, _ in reaction.wrong] == ["grows 3.00 times after the alarm"]
    assert any(line.startswith("| detents | 3 | 3 of 3") for line in reaction.lines)


def test_every_law_meets_every_hand() -> None:
    drawn = list(jobs(usual(STUDY, quick=True)))
    assert {job[:3] for job in drawn} == {
        (preset, law, hand) for preset in PRESETS for law in LAWS for hand in (*HANDS, "")
    }
    assert len({job[4] for job in drawn}) == len(drawn)
