"""Cases of a test of which a default run takes some, and ``--whole`` all."""

from collections.abc import Iterable
from typing import Any

import pytest


def sampled(cases: Iterable[Any], every: int) -> list[Any]:
    """Parameters of a test: one case in ``every`` by default, the others with ``--whole``.

    Args:
        cases: A tuple is the values of several arguments, anything else that of one.
        every: The first case stays, and each that many farther on.
    """
    return [
        pytest.param(
            *(case if isinstance(case, tuple) else (case,)),
            marks=[pytest.mark.whole] if number % every else [],
        )
        for number, case in enumerate(cases)
    ]


def is_left_to_whole(item: pytest.Item) -> bool:
    """Whether a test is marked ``whole`` or needs the fixture; a parameter may have that name."""
    given = item.callspec.params if hasattr(item, "callspec") else {}
    needed = "whole" in getattr(item, "fixturenames", ()) and "whole" not in given
    return needed or item.get_closest_marker("whole") is not None
