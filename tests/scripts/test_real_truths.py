"""What the study of true servos calls growing, swinging and thrown back is that."""

import numpy as np
import pytest

from scripts.guard_truths import (
    BELIEVED,
    COUNTS,
    TRUE,
    asked,
    gained,
    goes_on,
    truths,
)
from tests.support.truth import COUNT

WINDOWS = np.arange(10)
MIDDLE = np.full(len(BELIEVED), 0.5)
PLAIN = np.zeros((1, len(TRUE)))


@pytest.mark.parametrize(
    ("amplitude", "wanted"),
    [
        (0.1 * 1.05**WINDOWS, (True, True)),
        (0.1 * np.ones(10), (False, True)),
        (0.1 * 0.9**WINDOWS, (False, False)),
        (0.9 * COUNTS * COUNT * 1.01**WINDOWS, (False, False)),
        (0.1 * (1.0 + 0.5 * np.cos(np.pi * WINDOWS)) * 0.9**WINDOWS, (False, False)),
    ],
)
def test_growing_and_swinging_on(amplitude: np.ndarray, wanted: tuple[bool, bool]) -> None:
    found = amplitude[:, None, None]
    assert tuple(bool(each[0]) for each in goes_on(found)) == wanted


def test_a_wall_far_above_the_limit_throws_back_and_the_commanded_one_does_not() -> None:
    wall = asked(MIDDLE, "above")
    speed, phase = np.array([1.0]), np.array([0.9])
    commanded = gained(truths([wall], PLAIN), speed, phase, 1)
    stiffer = truths([wall], PLAIN, np.array([12.0 * wall.decision.stiffness]))
    assert commanded[0] < 0.0 < gained(stiffer, speed, phase, 1)[0]
