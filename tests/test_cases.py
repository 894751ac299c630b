"""A default run leaves out what ``--whole`` is for, and nothing else."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tests.cases import is_left_to_whole, sampled


def item(*fixtures: str, marks: tuple[str, ...] = (), **more: Any) -> pytest.Item:
    marked: Mapping[str, pytest.Mark] = {name: getattr(pytest.mark, name).mark for name in marks}
    some = SimpleNamespace(fixturenames=fixtures, get_closest_marker=marked.get, **more)
    return cast("pytest.Item", some)


def test_what_is_marked_or_needs_the_fixture_is_left_out_and_a_parameter_of_that_name_is_not() -> (
    None
):
    params = SimpleNamespace(params={"whole": True})
    assert is_left_to_whole(item("whole_experiment"))
    assert is_left_to_whole(item(marks=("whole",)))
    assert is_left_to_whole(item("whole", marks=("whole",), callspec=params))
    assert not is_left_to_whole(item("wholly", "undrawn", marks=("realtime",)))
    assert not is_left_to_whole(item("whole", callspec=params))


def test_of_many_cases_each_so_many_stay_and_none_is_lost() -> None:
    found = sampled(((number, "text") for number in range(7)), 3)
    assert [case.values for case in found] == [(number, "text") for number in range(7)]
    assert [case.values[0] for case in found if not case.marks] == [0, 3, 6]
    told = [[mark.name for mark in case.marks] for case in sampled(range(1000), 50)]
    assert told.count([]) == 20 and told.count(["whole"]) == 80
    assert told.count(["thorough"]) == 900
