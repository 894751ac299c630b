"""Cases of a test of which a default run takes some, and ``--whole`` all."""

from collections.abc import Iterable
from functools import partial
from typing import Any

import pytest

whole_only = partial(pytest.param, marks=pytest.mark.whole)
"""A case, given as to ``pytest.param``, that runs with ``--whole`` only"""


def sampled(cases: Iterable[Any], every: int) -> list[Any]:
    """Parameters of a test: one case in ``every`` by default, the others with ``--whole``.

    Args:
        cases: A tuple is the values of several arguments, anything else that of one.
        every: Every so many cases one stays, from the first one on.
    """
    return [
        (whole_only if number % every else pytest.param)(
            *(case if isinstance(case, tuple) else (case,))
        )
        for number, case in enumerate(cases)
    ]


def is_left_to_whole(item: pytest.Item) -> bool:
    """Whether a test is marked ``whole``, or needs the fixture ``whole_experiment``."""
    needed = "whole_experiment" in getattr(item, "fixturenames", ())
    return needed or item.get_closest_marker("whole") is not None
