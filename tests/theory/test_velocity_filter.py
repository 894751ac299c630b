"""A filter of the velocity in the loop: against an independent simulation and dense eigenvalues."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest
from scipy.signal import freqz

from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import one_mass, two_masses
from haptic_wall.controller.theory.velocity_filter import FilterKind, VelocityFilter
from tests.theory.oracles import LinkedLoop, linked_radius

PERIOD = 1e-3


@pytest.mark.parametrize("kind", ["lowpass", "notch"])
def test_the_response_is_that_of_the_taps(kind: FilterKind) -> None:
    filtered = VelocityFilter(kind, 0.3, 0.6)
    b0, b1, b2, a1, a2 = filtered.taps()
    w = np.linspace(0.0, math.pi, 50)
    _, expected = freqz([b0, b1, b2], [1.0, a1, a2], w)
    assert filtered.response(w) == pytest.approx(expected, abs=1e-12)
    assert np.all(np.abs(filtered.response(w)) <= 1.0 + 1e-12)
    at = abs(filtered.response(np.array([0.3]))[0])
    assert at == pytest.approx(0.0 if kind == "notch" else 0.6, abs=1e-12)


@pytest.mark.parametrize("kind", ["lowpass", "notch"])
def test_limits_agree_with_dense_eigenvalues(kind: FilterKind, wholly: bool) -> None:
    random = np.random.default_rng(4)
    count, found = 60 if wholly else 20, 0
    for _ in range(count):
        whole = float(np.exp(random.uniform(math.log(1e-3), math.log(0.03))))
        load = whole * float(random.uniform(0.05, 0.8))
        hz, ratio = float(np.exp(random.uniform(2.3, 5.0))), float(random.uniform(0.003, 0.1))
        moving, rate = (whole - load) * load / whole, math.tau * hz
        servo = (whole - load, whole, load, moving * rate**2, 2 * ratio * moving * rate)
        delay, samples = float(random.uniform(0.0, 4e-3)), int(random.choice([1, 1, 3]))
        encoder = str(random.choice(["output", "motor"]))
        f0 = hz * float(random.choice([1.0, random.uniform(0.3, 3.0)]))
        filtered = VelocityFilter(kind, math.tau * f0 * PERIOD, float(random.uniform(0.3, 2.0)))
        chain = two_masses(*servo, encoder=encoder)
        loop = LinkedLoop(*servo, PERIOD, delay / PERIOD, samples, encoder)
        radius = partial(linked_radius, loop, taps=filtered.taps())
        ceiling = float(chain_ceiling(*chain, PERIOD, delay, samples, filtered))
        b = float(random.uniform(0.05, 0.95)) * min(ceiling, 100.0 * whole)
        boundary = chain_boundary(*chain, b, PERIOD, delay, samples, filtered)
        limit = float(boundary.stiffness)
        if limit > 0.0:
            found += 1
            assert all(radius(share * limit, b) < 1.0 for share in (0.01, 0.3, 0.7, 1 - 1e-5))
            assert radius((1 + 1e-5) * limit, b) > 1.0
        if math.isfinite(ceiling):
            tiny = 1e-6 * whole / PERIOD**2
            assert radius(tiny, 1.001 * ceiling) > 1.0
    assert found > count / 2


def test_one_count_is_never_felt_more_than_the_filters_peak() -> None:
    filtered = VelocityFilter("notch", 0.3, 0.5)
    assert filtered.peak(1) == pytest.approx(filtered.taps()[0])
    assert VelocityFilter("lowpass", 0.3, 0.7).peak(1) < 0.2
    assert VelocityFilter("lowpass", 0.3, 0.7).peak(500) == pytest.approx(1.05, abs=0.02)


@pytest.mark.parametrize("w0, q", [(0.0, 1.0), (math.pi, 1.0), (0.1, 0.0)])
def test_a_filter_beyond_half_the_rate_is_refused(w0: float, q: float) -> None:
    with pytest.raises(ValueError, match="filter's"):
        VelocityFilter("notch", w0, q)


def test_a_crossing_inside_a_narrow_notch_is_not_missed() -> None:
    """There the spring's own oscillation has no virtual damping, so a soft wall grows."""
    notch, chain = VelocityFilter("notch", 0.0114, 6.6), one_mass(0.01, 0.001)
    ceiling = float(chain_ceiling(*chain, PERIOD, 2.35e-3, 1, notch))
    for share in (0.2, 0.5, 0.645):
        exact = chain_boundary(*chain, share * ceiling, PERIOD, 2.35e-3, 1, notch)
        assert exact.frequency * math.tau * PERIOD == pytest.approx(0.0114, rel=0.05)
