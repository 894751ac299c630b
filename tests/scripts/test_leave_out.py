"""The study that leaves out the detector's numbers: what it tries, and what it need not run."""

import math
from dataclasses import fields

import pytest

from haptic_wall.controller.detector.tuning import TUNING
from scripts.asked_numbers import Asked, asked_tuning
from scripts.studies import leave_out
from scripts.studies.leave_out import (
    CRITERIA,
    EVERY,
    Felt,
    Outcome,
    Row,
    scaled,
    varied,
    without,
)

CASE = next(
    name
    for name, (kind, case) in leave_out.table_cases().items()
    if kind == "hands" and case.duration_s < 20.0
)


def test_a_number_is_known_to_matter_only_beyond_what_it_was_compared_to() -> None:
    tuning, notes = asked_tuning()
    kept = notes["evidence.kept"]
    assert not kept.used
    assert tuning.evidence.kept * 0.9 < 1.0
    assert not tuning.evidence.kept * 0.9 < 0.5
    assert kept.used
    assert kept.allows(0.6)
    assert kept.allows(1.1)
    assert not kept.allows(0.5)
    assert not kept.allows(1.2)
    assert not kept.allows(math.inf)


def test_a_negative_factor_turns_the_range_around() -> None:
    tuning, notes = asked_tuning()
    assert -tuning.belief.shrinks > -0.5
    assert notes["belief.shrinks"].allows(0.4)
    assert not notes["belief.shrinks"].allows(0.6)
    assert notes["belief.shrinks"].allows(-1.0)


def test_a_number_that_is_computed_with_may_always_matter() -> None:
    tuning, notes = asked_tuning()
    assert 1.0 + tuning.energy.wrong == 1.0 + TUNING.energy.wrong
    assert not notes["energy.wrong"].allows(TUNING.energy.wrong)
    assert tuning.belief.regular + tuning.belief.scatter_counts > 0.0
    assert not notes["belief.regular"].allows(TUNING.belief.regular)
    assert not notes["belief.scatter_counts"].allows(TUNING.belief.scatter_counts)
    assert tuning.probe.scale**2 == 0.0625
    assert not notes["probe.scale"].allows(0.25)


def test_every_number_is_tried_and_every_try_can_be_set() -> None:
    numbers = {f"{g}.{one.name}" for g in EVERY for one in fields(getattr(TUNING, g))}
    tried: set[str] = set()
    for tries in (*map(without, EVERY), *map(scaled, EVERY), CRITERIA):
        for title, changed in tries.items():
            assert varied(changed) != TUNING, title
            tried |= changed.keys()
    assert tried == numbers


@pytest.mark.parametrize(
    ("value", "factor", "other"),
    [
        (0.98, 1.5, 0.97),  # the distance from 1
        (0.5, 1.5, 0.75),
        (3, 1.5, 4),
        (1, 1 / 1.5, 1),  # no number of things is 0
        (((3, 0.5), (8, 0.6)), 1.5, ((3, 0.75), (8, 0.9))),
    ],
)
def test_a_number_is_scaled_as_its_kind_allows(
    value: float | tuple[tuple[int, float], ...],
    factor: float,
    other: float | tuple[tuple[int, float], ...],
) -> None:
    scaled_value = leave_out._times(value, factor)
    if isinstance(scaled_value, tuple):
        assert isinstance(other, tuple)
        assert [count for count, _ in scaled_value] == [count for count, _ in other]
        assert [g for _, g in scaled_value] == pytest.approx([g for _, g in other])
    else:
        assert scaled_value == pytest.approx(other)


@pytest.mark.whole
@pytest.mark.parametrize("name", [CASE, "kicks 2 0", "recordings 2 0"])
def test_watched_numbers_change_no_run_and_what_they_allow_changes_none(
    name: str, thorough: bool
) -> None:
    if name != CASE and not thorough:
        pytest.skip("seconds; --thorough runs it")
    plain, notes = leave_out.as_it_is(name)
    assert leave_out.outcome(name, TUNING) == plain
    allowed = {
        number: value
        for group in EVERY
        for numbers in (without(group) | scaled(group)).values()
        for number, value in numbers.items()
        if not leave_out._may(notes, numbers)
    }
    assert len(allowed) > 10
    assert leave_out.outcome(name, varied(allowed)) == plain


def test_a_case_that_never_asks_is_not_run_again(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = Outcome("late", 2, "")
    monkeypatch.setattr(leave_out, "as_it_is", lambda _: (plain, {"probe.scale": Asked()}))
    monkeypatch.setattr(leave_out, "outcome", lambda *_: pytest.fail("it ran"))
    assert leave_out._felt_by(["walls-1"], {"probe.scale": 0.5}) == Felt(0, 0, 0, "")


def test_a_value_is_tried_until_an_answer_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = Outcome("in time", 0, "a")
    comes_to = {
        "walls-1": plain,
        "walls-2": Outcome("in time", 0, "b"),
        "walls-3": Outcome("late", 2, "c"),
    }
    asked = {"probe.scale": Asked(computed=True)}
    monkeypatch.setattr(leave_out, "as_it_is", lambda _: (plain, asked))
    monkeypatch.setattr(leave_out, "outcome", lambda name, _: comes_to[name])
    numbers = {"probe.scale": 0.5}
    found = leave_out._felt_by([*comes_to, "walls-4"], numbers)
    assert found == Felt(4, 3, 2, "walls: in time → late", worse=True)
    assert leave_out._felt_by(["walls-1", "walls-2"], numbers) == Felt(2, 2, 1, "")
    assert leave_out._felt_by(20 * ["walls-1"], numbers) == Felt(20, leave_out.MOST, 0, "")


def test_the_page_tells_what_got_worse_what_differs_and_what_was_not_run() -> None:
    plain, worse = Outcome("in time", 0, "a"), Outcome("late", 2, "b")
    first, second, *_ = CRITERIA
    assert list(leave_out.criteria_lines([])) == list(leave_out.numbers_lines([])) == ["Not run."]
    row = Row(plain, ["probe.scale"], [first, second], {first: worse})
    lines = list(leave_out.criteria_lines([("walls-1", row)]))
    assert (
        f"1 of {len(leave_out.table_cases())} cases; as the detector is: 1 walls: in time." in lines
    )
    assert f"| {first} | 1 | 1 | 1 | 1 walls: in time → late |  |" in lines
    assert any(
        line.startswith("No case differs") and f"{second} (1 of 1)" in line for line in lines
    )
    tries = {
        "probe.scale / 1.5": Felt(7, 2, 1, "walls: in time → late", worse=True),
        "probe.scale × 1.5": Felt(7, 4, 3, ""),
        "probe.scale": Felt(0, 0, 0, ""),
    }
    lines = list(leave_out.numbers_lines([("probe.scale", tries)]))
    assert "| `probe.scale / 1.5` | 7 | 2 |  | walls: in time → late |" in lines
    assert "Of the other values 1 change figures, but no answer; 0 change nothing;" in lines
    assert lines[-2:] == ["1 can change no case. With every value:", "none."]
    lines = list(leave_out.numbers_lines([("probe.scale", {"probe.scale": Felt(0, 0, 0, "")})]))
    assert lines[-1] == "`probe.scale`."
