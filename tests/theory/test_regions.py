"""The plane of friction: each region does in simulation what it is called."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.controller.theory.regions import Place, Region, place, servo_places
from tests.support.exact_servo import PlantParameters, State, step

PERIOD, COUNT = 1e-3, 1e-3
INERTIA, DAMPING = 5e-3, 0.02


FloatArray = NDArray[np.float64]


def region_of(at: Place) -> Region:
    """The region of one place, which stands in an array of no dimension."""
    return Region(str(at.region))


def run(coulomb: float, k: float, delay_steps: int, kick: float, push: float = 0.0) -> FloatArray:
    """Positions [counts] over three seconds, with a rounding encoder and a steady push."""
    plant = PlantParameters(INERTIA, DAMPING, coulomb)
    state = State(kick * COUNT, 0.0)
    ring = [-k * COUNT * round(kick)] * delay_steps
    seen = []
    for _ in range(3000):
        ring.append(-k * COUNT * round(state.position / COUNT))
        state = step(state, plant, ring.pop(0) + push, PERIOD)
        seen.append(state.position / COUNT)
        if abs(seen[-1]) > 1e6:
            break
    positions: FloatArray = np.abs(np.array(seen))
    return positions


@pytest.mark.parametrize("delay_steps", [0, 2])
def test_each_region_does_what_it_is_called(delay_steps: int) -> None:
    delay = delay_steps * PERIOD
    limit = float(critical_stiffness(INERTIA, DAMPING, 0.0, PERIOD, delay))
    for share in (0.5, 0.9, 1.3, 2.0):
        k = share * limit
        for dry in (0.2, 0.4, 0.6, 3.0):
            c = dry * k * COUNT
            region = region_of(place(INERTIA, DAMPING, c, COUNT, k, 0.0, PERIOD, delay))
            # a push that has its balance on the edge between two counts
            held = run(c, k, delay_steps, 0.5, push=0.5 * k * COUNT)
            rattles = np.ptp(held[-1000:]) > 0
            assert rattles == (region in (Region.LIMIT_CYCLE, Region.UNSTABLE))
            large = run(c, k, delay_steps, 3000.0)
            grows = large[-300:].max() > 3000
            assert grows == (region in (Region.LOCALLY_STABLE, Region.UNSTABLE))
            if region is Region.LIMIT_CYCLE:
                assert held.max() < 4  # a rattle of counts, not more


def test_small_motion_dies_where_it_is_locally_stable() -> None:
    k = 1.3 * float(critical_stiffness(INERTIA, DAMPING, 0.0, PERIOD, 0.0))
    c = 3 * k * COUNT
    at = place(INERTIA, DAMPING, c, COUNT, k, 0.0, PERIOD, 0.0)
    assert region_of(at) is Region.LOCALLY_STABLE
    assert np.ptp(run(c, k, 0, 10.0)[-300:]) == 0


def test_softer_walls_are_in_better_regions() -> None:
    places = {k: {at.name: at for at in servo_places(k, 0.0, 1e-3, 0.0)} for k in (3, 10, 50, 200)}
    assert {at.region for at in places[3].values()} == {Region.STABLE}
    assert places[10]["XL330-M288"].region is Region.LOCALLY_STABLE
    assert places[10]["XL-320"].region is Region.UNSTABLE  # its encoder is the coarsest
    assert {at.region for at in places[200].values()} == {Region.UNSTABLE}
    at = places[10]["MX-64"]
    assert at.viscous == pytest.approx(0.011692 / (10 * 1e-3))
    assert at.dry == pytest.approx(0.09039 / (10 * 2 * math.pi / 4096))


def test_virtual_damping_asks_for_more_friction() -> None:
    k, q = 5.0, 1e-3
    for big_b, region in ((0.0, Region.STABLE), (0.02, Region.LIMIT_CYCLE)):
        assert region_of(place(0.01, 0.02, 0.7 * k * q, q, k, big_b, 1e-3, 0.0)) is region


def test_it_broadcasts_and_no_quantisation_asks_for_no_friction() -> None:
    found = place(0.01, 0.01, 0.0, [0.0, 1e-3], [[5.0], [5000.0]], 0.0, 1e-3, 0.0)
    assert found.region.tolist() == [
        [Region.STABLE, Region.LIMIT_CYCLE],
        [Region.UNSTABLE, Region.UNSTABLE],
    ]
    assert np.isinf(found.dry[0, 0])


def test_errors_name_the_argument() -> None:
    with pytest.raises(ValueError, match="encoder_step must be >= 0, got -1"):
        place(0.01, 0.01, 0.1, -1.0, 1.0, 0.0, 1e-3, 0.0)
