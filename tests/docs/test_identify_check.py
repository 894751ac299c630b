"""The page's figures are what identification finds now."""

from pathlib import Path

import numpy as np
import pytest

from scripts.real_servos import ALL, EFFECTS
from scripts.real_servos import KINDS as REAL_KINDS
from scripts.studies.identify_check import (
    FIRST,
    KINDS,
    NAMES,
    SEEDS,
    Bounded,
    Kind,
    cells,
    effect_identified,
    holds,
    identified,
)
from scripts.study import table

PAGE = Path(__file__).parents[2] / "docs" / "evidence" / "identify-check.md"


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_a_seed_is_found_as_well_as_the_page_says(kind: Kind, thorough: bool) -> None:
    if kind is not KINDS[0] and not thorough:
        pytest.skip("seconds; --thorough runs it")
    cases = [identified((kind, seed)) for seed in range(SEEDS if thorough else 1)]
    text = PAGE.read_text()
    if thorough:
        rows = table([], *cells(kind, cases))[2:]
        assert [row for row in rows if row not in text] == []
        assert holds(cases)
        return
    (found,) = cases
    off = np.abs(np.subtract(found.found, found.truth))
    for name, error, truth in zip(NAMES, off, found.truth, strict=True):
        (row,) = (line for line in text.splitlines() if f"| {kind.name} | {name} |" in line)
        worst, unit = row.split("|")[4].split()
        said = float(worst) * (1e-3 if unit == "ms" else 1e-2 * truth)
        assert error <= said + 5e-4 * (1e-3 if unit == "ms" else 1e-2 * truth)


def test_the_bounds_of_a_real_servo_hold_it(thorough: bool) -> None:
    """The first of those that the page counts."""
    if not thorough:
        pytest.skip("seconds; --thorough runs it")
    cases = [(kind, effect, FIRST) for kind in REAL_KINDS for effect in (*EFFECTS, ALL)]
    found = [effect_identified(case) for case in cases]
    assert [each for each in found if not isinstance(each, Bounded) or not each.held] == []
