"""A real servo's recordings predict each other; synthetic bounds hold the truth."""

import numpy as np
import pytest

from haptic_wall.controller.experiments.recorded.record import pieces_of
from scripts.recorded_motions import DROPS, drop, error_of, predicted
from scripts.studies.recordings import FIRST, KINDS, checked, swings


def test_the_small_swing_is_predicted_by_the_large_one() -> None:
    """Coulomb and viscous friction leave 7 mrad of the large one, 11 of the small one."""
    small, large = DROPS
    shot = swings((large,), "M1")
    assert 0.004 < shot.residual < 0.010
    pieces, _ = pieces_of(drop(small))
    assert 0.005 < error_of(pieces, predicted(pieces, shot.terms)) < 0.020


@pytest.mark.whole
@pytest.mark.parametrize("kind", KINDS[:2])
def test_the_bounds_hold_the_truth(kind: str, thorough: bool) -> None:
    """Of few draws, none lies further out than three standard errors; the page has more."""
    draws = 4 if thorough else 1
    found = [checked((kind, FIRST + seed)) for seed in range(draws)]
    off = [value for each in found for value in each.off.values()]
    assert len(off) == draws * (3 if kind == KINDS[0] else 5)
    assert np.max(np.abs(off)) < 3.0
