"""Describing functions against Fourier integrals, and limit cycles against simulation in time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from haptic_wall.controller.theory.cycles import (
    Backlash,
    Coulomb,
    LimitCycle,
    Quantisation,
    Saturation,
    limit_cycles,
)
from haptic_wall.controller.theory.describing import (
    backlash_gain,
    quantisation_gain,
    saturation_gain,
)
from tests.cases import sampled
from tests.support.nonlinear_walls import PERIOD, Motion, Walls
from tests.theory.oracles import Loop

Array = NDArray[np.float64]


def first_harmonic(output: Array) -> complex:
    """Complex gain of what a cosine of amplitude 1 over one even turn became."""
    angle = 2 * np.pi * np.arange(output.size) / output.size
    return complex(2 * np.mean(output * np.exp(-1j * angle)))


def play(motion: Array, width: float) -> Array:
    followed, out = 0.0, []
    for x in np.tile(motion, 2):
        followed = min(max(followed, x - width / 2), x + width / 2)
        out.append(followed)
    return np.array(out[motion.size :])


@pytest.mark.parametrize("ratio", sampled([0.3, 0.501, 0.8, 1.0, 1.7, 6.3], 2))
def test_each_gain_is_the_first_harmonic(ratio: float) -> None:
    x = np.cos(2 * np.pi * np.arange(100_000) / 100_000)
    step = 1 / ratio
    for gain, output in (
        (saturation_gain(1.0, step), np.clip(x, -step, step)),
        (quantisation_gain(1.0, step), step * np.round(x / step)),
        (
            quantisation_gain(1.0, step, at_edge=True),
            step * (np.floor(x / step) + 0.5),
        ),
        (backlash_gain(1.0, step), play(x, step)),
    ):
        assert complex(gain) == pytest.approx(first_harmonic(output), abs=2e-3)


def in_motion(
    loops: list[Loop], cycles: list[LimitCycle], effect: object, scales: list[float]
) -> Motion:
    """Walls without friction at a turning point, after an oscillation so many times the cycle's."""

    def column(name: str) -> Array:
        return np.array([getattr(loop, name) for loop in loops])

    one = np.ones(len(loops))
    walls = Walls(
        inertia=column("inertia"),
        damping=column("damping"),
        stiffness=column("stiffness"),
        virtual_damping=column("virtual_damping"),
        delay=column("delay"),
        limit=getattr(effect, "limit", math.inf) * one,
        count=getattr(effect, "step", 0.0) * one,
        edge=(0.5 if getattr(effect, "at_edge", False) else 0.0) * one,
        backlash=getattr(effect, "width", 0.0) * one,
    )
    amplitude = np.array(scales) * np.array([cycle.amplitude for cycle in cycles])
    return Motion(walls, amplitude, np.array([cycle.frequency for cycle in cycles]))


def measured(seen: Array, cycle: LimitCycle) -> tuple[float, float]:
    """Amplitude and frequency over the last ten turns of a steady oscillation."""
    last = seen[-int(10 / cycle.frequency / PERIOD) :]
    middle = last - last.mean()
    ups = np.flatnonzero((middle[1:] > 0) & (middle[:-1] <= 0))
    at = ups + middle[ups] / (middle[ups] - middle[ups + 1])
    return float(np.ptp(last)) / 2, (at.size - 1) / (at[-1] - at[0]) / PERIOD


def walls(count: int, seed: int, share: tuple[float, float], damper: float) -> list[Loop]:
    """Walls on random devices at a share of the critical stiffness."""
    random = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        m = 10 ** random.uniform(-2.7, -1.5)
        b, delay = m * random.uniform(1, 10), random.uniform(0, 5) * PERIOD
        big_b = random.uniform(0, damper) * float(max_virtual_damping(m, b, PERIOD, delay))
        k = random.uniform(*share) * float(critical_stiffness(m, b, big_b, PERIOD, delay))
        found.append(Loop(m, b, k, big_b, PERIOD, delay))
    return found


def predicted(
    loop: Loop, effect: Coulomb | Saturation | Quantisation | Backlash
) -> list[LimitCycle]:
    m, b, k, big_b, period, delay, _, _ = loop
    return limit_cycles(m, b, k, big_b, period, delay, effect)


# What is simulated, and by how much it may differ from the prediction: a share of the amplitude,
# and of the frequency. A play is met to a few percent. A saturated torque turns into a square wave
# far above the limit, and far sooner with a damper: along the ray of (K, B) the boundary may then
# be far away. Cycles of about a count are rough, because the samples fall where they fall.
SPRINGS, DAMPERS = 0.0, 0.2  # of the ceiling
Pair = tuple[float, float]
Effect = Coulomb | Saturation | Quantisation | Backlash
CASES: dict[str, tuple[Effect, Pair, float, Pair, Pair]] = {
    "saturation": (Saturation(1.0), (1.05, 3.0), SPRINGS, (0.99, 1.15), (0.92, 1.01)),
    "saturation and damper": (Saturation(1.0), (1.05, 3.0), DAMPERS, (0.99, 1.7), (0.75, 1.01)),
    "backlash": (Backlash(4e-3), (0.3, 0.9), SPRINGS, (0.95, 1.05), (0.97, 1.01)),
    "backlash and damper": (Backlash(4e-3), (0.3, 0.9), DAMPERS, (0.9, 1.02), (0.96, 1.02)),
    "middle of a count": (Quantisation(1.5e-3), (0.82, 0.95), SPRINGS, (0.6, 1.4), (0.9, 1.07)),
    "edge of a count": (
        Quantisation(1.5e-3, at_edge=True),
        (0.3, 0.8),
        SPRINGS,
        (0.9, 1.4),
        (0.85, 1.05),
    ),
}


def both_ways(
    loops: list[Loop], cycles: list[LimitCycle], below: float, above: float
) -> tuple[list[Loop], list[LimitCycle], list[float]]:
    """Each loop twice, to be started below and above its cycle."""
    return loops * 2, cycles * 2, [below] * len(loops) + [above] * len(loops)


@pytest.mark.parametrize("name", sampled(CASES, 6))
def test_motion_comes_to_the_stable_cycle(name: str, thorough: bool) -> None:
    effect, share, damper, amplitude, frequency = CASES[name]
    loops, cycles = [], []
    for loop in walls(50 if thorough else 10, 5, share, damper):
        stable = [cycle for cycle in predicted(loop, effect) if cycle.stable]
        if stable:
            loops.append(loop)
            cycles.append(stable[-1])
    assert len(loops) >= 8
    loops, cycles, scales = both_ways(loops, cycles, 0.9, 1.2)
    seen = in_motion(loops, cycles, effect, scales).run(15_000)
    for i, cycle in enumerate(cycles):
        found = measured(seen[:, i], cycle)
        assert amplitude[0] < found[0] / cycle.amplitude < amplitude[1]
        assert frequency[0] < found[1] / cycle.frequency < frequency[1]


def closes_in(loops: list[Loop], cycles: list[LimitCycle], effect: Backlash, apart: float) -> None:
    """Motion begun ``apart`` below a cycle grows, and above it shrinks."""
    twice, again, scales = both_ways(loops, cycles, 1 - apart, 1 + apart)
    turn = int(1 / min(cycle.frequency for cycle in cycles) / PERIOD)
    seen = in_motion(twice, again, effect, scales).run(12 * turn)
    for i, cycle in enumerate(again):
        ended = np.ptp(seen[-int(1.2 / cycle.frequency / PERIOD) :, i]) / 2 / cycle.amplitude
        assert (ended > scales[i]) == (scales[i] < 1), (twice[i], cycle, scales[i], ended)


def test_every_lightly_damped_wall_below_its_limit_has_a_cycle_of_its_play(
    thorough: bool, wholly: bool
) -> None:
    random = np.random.default_rng(13)
    effect, loops, cycles = Backlash(2e-3), [], []
    for _ in range(150 if thorough else 30 if wholly else 8):
        m, delay = 10 ** random.uniform(-2.7, -1.5), random.uniform(0, 5) * PERIOD
        b = m * random.uniform(1, 10)
        damper = random.choice([0.0, 0.2 * random.random() ** 2])
        big_b = damper * float(max_virtual_damping(m, b, PERIOD, delay))
        share = random.choice([random.uniform(0.4, 0.9), 1 - 10 ** random.uniform(-2.3, -1)])
        k = share * float(critical_stiffness(m, b, big_b, PERIOD, delay))
        loops.append(Loop(m, b, k, big_b, PERIOD, delay))
        stable = [cycle for cycle in predicted(loops[-1], effect) if cycle.stable]
        assert len(stable) == 1, loops[-1]
        cycles += stable
    closes_in(loops, cycles, effect, 0.12)


def test_motion_leaves_the_unstable_cycle_both_ways() -> None:
    effect = Quantisation(1.5e-3)
    loops = walls(12, 6, (1.3, 2.5), SPRINGS)
    cycles = [predicted(loop, effect)[0] for loop in loops]
    assert not any(cycle.stable for cycle in cycles)
    loops, cycles, scales = both_ways(loops, cycles, 0.9, 1.1)
    seen = in_motion(loops, cycles, effect, scales).run(8_000)
    for i, cycle in enumerate(cycles):
        assert (np.max(np.abs(seen[-300:, i])) > 3 * cycle.amplitude) == (scales[i] > 1)


def test_a_stable_wall_has_no_cycle_by_friction_or_saturation_and_an_unstable_one_has(
    wholly: bool,
) -> None:
    for loop in walls(20 if wholly else 5, 7, (0.2, 0.95), 0.5):
        assert predicted(loop, Coulomb(0.05)) == predicted(loop, Saturation(1.0)) == []
        stiffer = loop._replace(stiffness=6 * loop.stiffness)
        friction, saturation = (
            predicted(stiffer, Coulomb(0.05)),
            predicted(stiffer, Saturation(1.0)),
        )
        assert [cycle.stable for cycle in friction] == [False]
        assert [cycle.stable for cycle in saturation] == [True]


def test_below_half_a_count_nothing_is_measured() -> None:
    np.testing.assert_array_equal(quantisation_gain([1e-4, 4.9e-4], 1e-3), 0)
    np.testing.assert_array_equal(backlash_gain([1e-4, 4.9e-4], 1e-3), 0)
    assert quantisation_gain(1e6, 1.0) == 1.0


def test_errors_name_the_argument() -> None:
    with pytest.raises(ValueError, match="stiffness must be > 0, got 0"):
        limit_cycles(0.01, 0.01, 0.0, 0.0, PERIOD, 0.0, Saturation(1.0))
    with pytest.raises(ValueError, match="width must be > 0, got 0"):
        limit_cycles(0.01, 0.01, 1.0, 0.0, PERIOD, 0.0, Backlash(0.0))
    with pytest.raises(ValueError, match="step must be > 0, got -1"):
        quantisation_gain(1.0, -1.0)
