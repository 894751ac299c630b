"""The quick limits of two masses beside the exact ones."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import two_masses
from haptic_wall.controller.theory.flexible_scan import FlexibleScan, Servos
from haptic_wall.controller.theory.velocity_filter import VelocityFilter


@pytest.mark.parametrize("encoder", ["output", "motor"])
@pytest.mark.parametrize(
    ("period", "delay", "samples", "filtered"),
    [
        (1e-3, 0.0, 1, None),
        (1e-3, 3.3e-3, 1, None),
        (4e-3, 1e-3, 1, None),
        (1e-3, 0.0, 4, None),
        (1e-3, 3.3e-3, 1, VelocityFilter("notch", 0.25, 0.8)),
        (1e-3, 1e-3, 4, VelocityFilter("notch", 0.1, 3.0)),
        (1e-3, 1e-3, 1, VelocityFilter("lowpass", 0.25, 0.7)),
    ],
)
def test_random_servos(
    encoder: str,
    period: float,
    delay: float,
    samples: int,
    filtered: VelocityFilter | None,
    thorough: bool,
) -> None:
    random = np.random.default_rng(1)
    n = 400 if thorough else 30

    def between(low: float, high: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.exp(random.uniform(np.log(low), np.log(high), n))

    inertia = between(1e-3, 0.03)
    load = inertia * between(0.05, 3.0)
    moving, rate = inertia * load / (inertia + load), 2 * np.pi * between(8.0, 200.0)
    stiffness = moving * rate**2
    damping = 2 * between(0.003, 0.2) * moving * rate
    servo = (inertia, inertia * between(0.05, 7.0), load, stiffness, damping)
    (scan,) = FlexibleScan.of([Servos(*servo, delay)], period, samples, encoder, filtered)
    chain = two_masses(*servo, encoder=encoder)
    ceiling = chain_ceiling(*chain, period, delay, samples, filtered)
    assert np.all(scan.ceilings() < 1.025 * ceiling)
    assert np.all(scan.ceilings() > 0.95 * ceiling)
    big_b = 0.7 * random.random(n) * ceiling
    exact = chain_boundary(*chain, big_b, period, delay, samples, filtered).stiffness
    limits = scan.limits(big_b)
    assert np.all(limits < 1.02 * exact)
    assert np.all(limits > 0.95 * exact)
    assert np.all(scan.limits(1.03 * ceiling) == 0.0)
