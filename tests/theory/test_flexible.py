"""Two masses, a current loop that lags: closed-loop poles as oracle; rigid and published limits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import Chain, two_masses
from haptic_wall.controller.theory.checks import FloatArray
from tests.cases import sampled
from tests.theory.oracles import LinkedLoop, linked_radius


def drawn(count: int, encoder: str, *, lag: bool, unlike: bool = False) -> list[LinkedLoop]:
    """Unlike masses: 0.001 to 100 times the motor's, damping ratios from 1e-7 on."""
    random = np.random.default_rng(7 + 2 * lag + (encoder == "motor"))
    loops = []
    for _ in range(count):
        m = 10 ** random.uniform(-4, -1)
        load = m * 10 ** (random.uniform(-3, 2) if unlike else random.uniform(-2, 1))
        moved = m * load / (m + load)
        mode = 2 * np.pi * 10 ** random.uniform(0.7, 2.7)
        if unlike:
            mode = np.sqrt(10 ** random.uniform(0, 5) / moved)
        loops.append(
            LinkedLoop(
                inertia=m,
                damping=m * (0.0 if unlike else 1.0) * 10 ** random.uniform(-3, 1.5),
                load=load,
                spring=moved * mode**2,
                damper=2 * 10 ** random.uniform(-7 if unlike else -3, -0.7) * mode * moved,
                period=10 ** random.uniform(-3.5, -2.5 if unlike else -2),
                late=random.choice([float(random.integers(0, 9)), random.uniform(0, 12)]),
                samples=int(random.choice([1, 1, 2, 3, 8])),
                encoder=encoder,
                bandwidth=10 ** random.uniform(1, 3) if lag else 0.0,
            )
        )
    return loops


def answers(
    loops: list[LinkedLoop], shares: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Ceilings, dampings at these shares of them, and the boundary's stiffnesses."""
    columns = (np.array(column) for column in zip(*(loop[:8] for loop in loops), strict=True))
    m, b, load, k, c, period, late, n = columns
    lag = np.array([loop.bandwidth for loop in loops])
    encoder, bandwidth = loops[0].encoder, lag if lag.all() else None
    servo = (m, b, load, k, c)
    ceiling = chain_ceiling(
        *two_masses(*servo, encoder=encoder, bandwidth=bandwidth), period, late * period, n
    )
    dampings = shares * ceiling
    found = chain_boundary(
        *two_masses(*servo, encoder=encoder, bandwidth=bandwidth),
        dampings,
        period,
        late * period,
        n,
    )
    return ceiling, dampings, found.stiffness


@pytest.mark.parametrize("lag", sampled([True, False], 2))
@pytest.mark.parametrize("encoder", ["output", "motor"])
def test_poles_leave_the_circle_exactly_at_the_boundary(
    encoder: str, lag: bool, thorough: bool
) -> None:
    loops = drawn(2_500 if thorough else 60, encoder, lag=lag)
    ceiling, dampings, stiffness = answers(
        loops, np.random.default_rng(3).uniform(0.0, 0.999, len(loops))
    )
    assert np.all(stiffness > 0)
    for loop, big_b, top, limit in zip(loops, dampings, ceiling, stiffness, strict=True):
        for share in (0.03, 0.3, 0.8, 1 - 1e-6):
            assert linked_radius(loop, share * limit, big_b) < 1.0
        assert linked_radius(loop, (1 + 1e-6) * limit, big_b) > 1.0
        # without stiffness a pole is at 1, rounded to 1e-13
        assert linked_radius(loop, 0.0, 0.999 * top) < 1.0 + 1e-11
        assert linked_radius(loop, 0.0, 1.001 * top) > 1.0 + 1e-9


@pytest.mark.parametrize("lag", [False, True])
@pytest.mark.parametrize("encoder", sampled(["output", "motor"], 2))
def test_hardly_damped_masses_of_very_unlike_size(encoder: str, lag: bool, thorough: bool) -> None:
    loops = drawn(2_500 if thorough else 40, encoder, lag=lag, unlike=True)
    shares = np.random.default_rng(5).uniform(0.0, 0.999, len(loops))
    _, dampings, stiffness = answers(loops, shares)
    assert np.all(stiffness > 0)
    for loop, big_b, limit in zip(loops, dampings, stiffness, strict=True):
        for share in (0.03, 0.3, 0.8, 1 - 1e-4):
            assert linked_radius(loop, share * limit, big_b) < 1.0
        assert linked_radius(loop, (1 + 1e-4) * limit, big_b) > 1.0


def test_no_stiffness_above_the_ceiling() -> None:
    loops = drawn(40, "output", lag=False)
    _, _, stiffness = answers(loops, np.full(len(loops), 1.001))
    assert np.all(stiffness == 0.0)


@pytest.mark.parametrize("encoder", ["output", "motor"])
def test_without_any_damping_limits_are_those_of_hardly_any(encoder: str) -> None:
    random = np.random.default_rng(1)
    m, load, rate = 10 ** random.uniform(-3, -1, (3, 30)) * [[1.0], [1.0], [4e4]]
    delay = random.uniform(0.0, 4e-3, 30)

    def ceiling(ratio: float) -> FloatArray:
        moved = m * load / (m + load)
        servo = (m, 0.0, load, moved * rate**2, 2.0 * ratio * moved * rate)
        return chain_ceiling(*two_masses(*servo, encoder=encoder), 1e-3, delay)

    assert np.all(ceiling(0.0) < 1.001 * ceiling(1e-8))


def test_a_stiff_transmission_is_none() -> None:
    m, load, b, period, delay = 0.012, 0.003, 0.0117, 1e-3, 1.4e-3
    big_b = np.array([0.0, 0.02, 0.5])
    rigid = critical_stiffness(m + load, b, big_b, period, delay)
    damper = 2 * 0.05 * np.sqrt(1e8 * m * load / (m + load))
    found = chain_boundary(*two_masses(m, b, load, 1e8, damper), big_b, period, delay).stiffness
    np.testing.assert_allclose(found, rigid, rtol=1e-5)


def test_three_masses_with_one_stiff_transmission_are_two() -> None:
    m, load, k, c = 0.012, 0.004, 150.0, 0.02
    three = Chain(
        np.array([[0.5 * m, 0.5 * m, load]]),
        np.array([[0.0117, 0.0, 0.0]]),
        np.array([[1e7, k]]),
        np.array([[20.0, c]]),
    )
    big_b = np.array([0.0, 0.05, 0.1])
    two = chain_boundary(*two_masses(m, 0.0117, load, k, c), big_b, 1e-3, 2e-3).stiffness
    found = chain_boundary(three, (1,), big_b, 1e-3, 2e-3).stiffness
    np.testing.assert_allclose(found, two, rtol=1e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"load_inertia": 0.0}, "load_inertia must be > 0, got 0"),
        ({"delay": 11.0}, "delay must be at most 10000 periods, got 11000"),
        ({"encoder": "gear"}, "encoder must be 'output' or 'motor', got 'gear'"),
        ({"bandwidth": -1.0}, "bandwidth must be > 0, got -1"),
    ],
)
def test_what_is_outside_of_the_domain_is_named(
    change: dict[str, float | str], message: str
) -> None:
    servo = {"inertia": 0.01, "damping": 0.01, "load_inertia": 0.01}
    servo |= {"transmission_stiffness": 100.0, "transmission_damping": 0.0}
    given: dict[str, Any] = servo | change
    delay = given.pop("delay", 1e-3)
    with pytest.raises(ValueError, match=message):
        chain_boundary(*two_masses(**given), 0.0, 1e-3, delay)
