"""Half-cycles of made-up motions: where they end, how long and how large, and what seems to move.

All positions are in rad, times in s, torques in N·m.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np
import pytest

from haptic_wall.controller.detector.half_cycles import HalfCycles
from haptic_wall.controller.detector.regularity import lasts, same_period
from haptic_wall.controller.theory.checks import FloatArray

PERIOD = 1e-3
COUNT = math.tau / 4096


def watched(
    positions: Iterable[float],
    torques: Sequence[float] | None = None,
    count: float = 0.0,
) -> tuple[HalfCycles, FloatArray]:
    """The watcher after all samples, and a row (duration, amplitude) for each half-cycle."""
    found = []
    seen = HalfCycles(PERIOD, count)
    for k, position in enumerate(positions):
        torque = 0.0 if torques is None else torques[k]
        if seen.update(position, torque, PERIOD):
            found.append((seen.last[-1].duration, seen.last[-1].amplitude))
    return seen, np.array(found).reshape(-1, 2)


def cosine(hertz: float, amplitude: float, seconds: float, count: float = 0.0) -> FloatArray:
    time = np.arange(float(round(seconds / PERIOD))) * PERIOD
    position: FloatArray = amplitude * np.cos(math.tau * hertz * time)
    return np.round(position / count) * count if count else position


@pytest.mark.parametrize("hertz", [1.0, 4.7, 30.0])
def test_a_sinusoid_is_cut_at_its_turning_points(hertz: float) -> None:
    seen, found = watched(cosine(hertz, 0.1, 5.0 / hertz))
    assert len(found) in (8, 9)
    assert found[1:, 0] == pytest.approx(0.5 / hertz, abs=1.01 * PERIOD)
    # A turning point lies at most half a period beside a sample.
    lost = 1.0 - math.cos(math.pi * hertz * PERIOD)
    assert found[:, 1] == pytest.approx(0.1, abs=0.1 * lost + 1e-9)
    assert lasts(seen.last)
    assert same_period(seen.last)


@pytest.mark.parametrize("counts", [4, 10, 100])
def test_on_a_coarse_encoder_a_half_cycle_is_as_long_on_the_mean(counts: int) -> None:
    """A turning point is the first sample on the outermost count, at either side alike."""
    _, found = watched(cosine(3.0, counts * COUNT, 4.0, COUNT), count=COUNT)
    assert len(found) in (22, 23)
    assert found[1:, 0].mean() == pytest.approx(1.0 / 6.0, rel=0.02)
    assert found[:, 1] == pytest.approx(counts * COUNT, abs=0.51 * COUNT)


@pytest.mark.parametrize("size", [0.4, 1.0, 1.49])
def test_flicker_of_a_count_is_no_turning_point(size: float) -> None:
    still = [size * COUNT * (k % 2) for k in range(1000)]
    seen, _ = watched(still, count=COUNT)
    assert len(seen.last) == 0


def oscillator(inertia: float, stiffness: float) -> tuple[list[float], list[float]]:
    """A mass on a spring whose torque is held over each sample; the exact motion.

    Position of each sample, and the torque that was commanded over the time before it.
    """
    positions, torques = [0.1], [0.0]
    position, velocity = 0.1, 0.0
    for _ in range(3000):
        torque = -stiffness * position
        acceleration = torque / inertia
        position += velocity * PERIOD + 0.5 * acceleration * PERIOD * PERIOD
        velocity += acceleration * PERIOD
        positions.append(position)
        torques.append(torque)
    return positions, torques


@pytest.mark.parametrize(("inertia", "stiffness"), [(0.012, 5.0), (0.012, 50.0), (0.001, 0.6)])
def test_a_mass_on_a_spring_seems_as_heavy_as_it_is(inertia: float, stiffness: float) -> None:
    seen, found = watched(*oscillator(inertia, stiffness))
    assert found[1:, 0].mean() == pytest.approx(math.pi * math.sqrt(inertia / stiffness), rel=0.01)
    assert seen.last[-1].inertia == pytest.approx(inertia, rel=0.03)
    assert seen.last[-2].inertia == pytest.approx(inertia, rel=0.03)


@pytest.mark.parametrize("rest_s", [0.0, 0.2])
def test_the_first_half_cycle_has_the_torque_of_all_its_time(rest_s: float) -> None:
    """The mean torque is the load that is held in a probe: one without its begin is too low."""
    rest = np.full(round(rest_s / PERIOD), 0.1)
    seen, _ = watched(np.concatenate([rest, cosine(5.0, 0.1, 0.15)]), [-2.0] * 1000)
    assert len(seen.last) == 1
    assert seen.load == pytest.approx(-2.0, rel=0.02)


@pytest.mark.parametrize("count", [0.0, COUNT])
def test_a_small_motion_is_seen_soon_after_one_many_times_its_size(count: float) -> None:
    """What turns back by less than a part of the last motion is a ripple only for so long."""
    large = cosine(5.0, 0.5, 0.5, count)
    ripple = cosine(15.0, 0.03, 0.4, count)
    small = cosine(14.0, 0.02, 2.0, count)
    _, found = watched(np.concatenate([large, ripple, small]), count=count)
    assert found[-20:, 0] == pytest.approx(0.5 / 14.0, abs=1.01 * PERIOD)
    assert found[-20:, 1] == pytest.approx(0.02, abs=count + 1e-3)
