"""A link's walls decay at intervals between two bins of the schedule, where they once grew."""

from dataclasses import replace

import numpy as np
import pytest

from haptic_wall.controller.guard.bins import Bins
from haptic_wall.controller.guard.schedule import interval_bins_ns
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from scripts.guard_links import NAMES, PERIOD, Members, chain_of, drawn, growth, inside

TRUTHS = 300


@pytest.mark.whole
@pytest.mark.parametrize(
    ("number", "steps", "shortest", "longest"),
    [(87, 0, 1.05, 2.1), (16, 0, 1.05, 2.1)],
)
def test_a_wall_decays_at_every_interval_of_its_bin(
    number: int, steps: int, shortest: float, longest: float
) -> None:
    """Beliefs whose wall grew somewhere in a bin that counted its upper end alone."""
    random = np.random.default_rng((7, number))
    belief, age, _ = drawn(random)
    request = Request(1e9, 1e9, "both")
    situation = Situation(belief, PERIOD, 4.1, 0.0)
    shares = (random.random((TRUTHS, len(NAMES))) < 0.5).astype(float)
    truths = inside(belief, shares)
    chain = chain_of(truths, belief.encoder)
    interval = random.uniform(shortest, longest, TRUTHS) * PERIOD
    interval[:20] = shortest * PERIOD
    young = random.random(TRUTHS) * age
    edges = interval_bins_ns(round(PERIOD * 1e9), flexible=True)
    bins = Bins(request, GuardSettings(), situation, steps, [round(age * 1e9)], edges)
    delay = young + steps * PERIOD
    checked = 0
    for index, edge in enumerate(edges):
        low, high = (share * edge * 1e-9 for share in bins.at(index)[1].served)
        part = (interval >= low) & (interval < high)
        if not part.any():
            continue
        (wall,) = bins.decide_interval(index)
        assert wall.stiffness > 0.0
        servos = chain.take(np.flatnonzero(part))
        some = Members(truths[part], servos, interval[part], delay[part])
        assert growth(some, wall, None).max() < 0.0
        assert growth(some, replace(wall, stiffness=30.0 * wall.stiffness), None).max() > 0.0
        checked += int(part.sum())
    assert checked == TRUTHS
