"""Cases of a test of which a default run takes some, and ``--whole`` all."""

from collections.abc import Iterable
from functools import partial
from typing import Any

import pytest

whole_only = partial(pytest.param, marks=pytest.mark.whole)
"""A case, given as to ``pytest.param``, that runs with ``--whole`` only"""


MOST = 100
"""About so many cases of a list run with ``--whole``"""


def sampled(cases: Iterable[Any], every: int) -> list[Any]:
    """Parameters of a test: one case in ``every`` by default, the others with ``--whole``.

    Of a long list ``--whole`` runs about ``MOST``, and ``--thorough`` all.

    Args:
        cases: A tuple is the values of several arguments, anything else that of one.
        every: Every so many cases one stays, from the first one on.
    """
    found = list(cases)
    step = max(1, len(found) // MOST)
    return [
        pytest.param(
            *(case if isinstance(case, tuple) else (case,)),
            marks=()
            if number % every == 0
            else pytest.mark.whole
            if number % step == 0
            else pytest.mark.thorough,
        )
        for number, case in enumerate(found)
    ]


def is_left_to_whole(item: pytest.Item) -> bool:
    """Whether a test is marked ``whole`` or ``thorough``, or needs ``whole_experiment``."""
    needed = "whole_experiment" in getattr(item, "fixturenames", ())
    return needed or any(map(item.get_closest_marker, ("whole", "thorough")))
