"""Cores: the loop has one of its own where there are two, and one that may be used."""

import os

import pytest

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.runtime.realtime import pick_cores


@pytest.mark.parametrize(
    ("allowed", "wanted", "core", "others"),
    [
        ({0, 1, 2}, None, 2, {0, 1}),
        ({0, 1, 2}, 0, 0, {1, 2}),
        ({3, 5}, 5, 5, {3}),
        ({4}, None, 4, {4}),
    ],
)
def test_everything_else_stays_off_the_loops_core(
    allowed: set[int],
    wanted: int | None,
    core: int,
    others: set[int],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(allowed))
    assert pick_cores(wanted) == (core, others)


def test_a_core_that_may_not_be_used_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    with pytest.raises(UserError, match=r"realtime\.core: found 99, wanted one of .*: 0, 1"):
        pick_cores(99)
