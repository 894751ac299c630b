"""Processes that compute end when they should: with their work, their parent, or its patience."""

from __future__ import annotations

import os
import time

import pytest

from haptic_wall.controller.errors import PlatformError
from haptic_wall.controller.experiments.processes import processes

_LONG = 600.0


def test_they_compute() -> None:
    with processes(2) as pool:
        assert list(pool.map(abs, [-1, -2, -3])) == [1, 2, 3]


@pytest.mark.parametrize("reason", [KeyboardInterrupt, ValueError])
def test_a_task_under_way_is_not_waited_for_when_the_block_is_left_early(
    reason: type[KeyboardInterrupt | ValueError],
) -> None:
    begin = time.monotonic()
    with pytest.raises(reason), processes(1) as pool:
        assert pool.submit(abs, -1).result() == 1  # it is up
        pool.submit(time.sleep, _LONG)
        pool.submit(time.sleep, _LONG)
        time.sleep(0.2)  # the first of them has begun, or is cancelled: either will do
        raise reason
    assert time.monotonic() - begin < _LONG / 2


def test_one_that_dies_is_an_error_that_says_so() -> None:
    with (
        pytest.raises(PlatformError, match="was killed from outside, perhaps for lack of memory"),
        processes(1) as pool,
    ):
        pool.submit(os._exit, 9).result()
