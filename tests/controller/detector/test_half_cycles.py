"""Half-cycles of made-up motions: where they end, how long and how large, and what seems to move.

All positions are in rad, times in s, torques in N·m.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_wall.controller.detector.half_cycles import HalfCycles
from haptic_wall.controller.detector.regularity import lasts, same_period
from haptic_wall.controller.detector.tuning import TUNING
from haptic_wall.controller.theory.checks import FloatArray

PERIOD = 1e-3
COUNT = math.tau / 4096


def watched(
    positions: Iterable[float],
    torques: Sequence[float] | None = None,
    count: float = 0.0,
    spans: Sequence[float] | None = None,
) -> tuple[HalfCycles, FloatArray]:
    """The watcher after all samples, and a row (duration, amplitude) for each half-cycle."""
    found = []
    seen = HalfCycles(PERIOD, count, TUNING)
    for k, position in enumerate(positions):
        torque = 0.0 if torques is None else torques[k]
        if seen.update(position, torque, PERIOD if spans is None else spans[k]):
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
    assert lasts(seen.last, TUNING)
    assert same_period(seen.last, TUNING)


@pytest.mark.parametrize("counts", [4, 10, 100])
def test_on_a_coarse_encoder_a_half_cycle_is_as_long_on_the_mean(counts: int) -> None:
    """A turning point is the first sample on the outermost count, at either side alike."""
    _, found = watched(cosine(3.0, counts * COUNT, 4.0, COUNT), count=COUNT)
    assert len(found) in (22, 23)
    assert found[1:, 0].mean() == pytest.approx(1.0 / 6.0, rel=0.02)
    assert found[:, 1] == pytest.approx(counts * COUNT, abs=0.51 * COUNT)


def test_a_growing_motion_lasts_and_a_dying_one_does_not() -> None:
    time = np.arange(1500) * PERIOD
    wave = np.cos(math.tau * 5.0 * time)
    growing, _ = watched(0.1 * np.exp(0.3 * time) * wave)
    assert lasts(growing.last, TUNING)
    dying, _ = watched(0.1 * np.exp(-0.3 * time) * wave)
    assert not lasts(dying.last, TUNING)


@pytest.mark.parametrize("size", [0.4, 1.0, 1.49])
def test_flicker_of_a_count_is_no_turning_point(size: float) -> None:
    still = [size * COUNT * (k % 2) for k in range(1000)]
    seen, _ = watched(still, count=COUNT)
    assert len(seen.last) == 0


@pytest.mark.parametrize("ripple", [0.0002, 0.0005])
def test_a_ripple_on_a_large_motion_is_no_turning_point(ripple: float) -> None:
    time = np.arange(2000) * PERIOD
    _, found = watched(cosine(2.0, 0.1, 2.0) + ripple * np.cos(math.tau * 60.0 * time))
    assert found[-5:, 0] == pytest.approx(0.25, abs=0.02), "at first ripples may count"


def oscillator(
    inertia: float, stiffness: float, gain: float = 1.0, every: int = 1
) -> tuple[list[float], list[float]]:
    """A mass on a spring whose torque is held over each sample; the exact motion.

    Position of each sample, and the torque that was commanded over the time before it.
    """
    positions, torques = [0.1], [0.0]
    position, velocity = 0.1, 0.0
    span = every * PERIOD
    for _ in range(3000 // every):
        torque = -stiffness * position
        acceleration = gain * torque / inertia
        position += velocity * span + 0.5 * acceleration * span * span
        velocity += acceleration * span
        positions.append(position)
        torques.append(torque)
    return positions, torques


@pytest.mark.parametrize(("inertia", "stiffness"), [(0.012, 5.0), (0.012, 50.0), (0.001, 0.6)])
def test_a_mass_on_a_spring_seems_as_heavy_as_it_is(inertia: float, stiffness: float) -> None:
    seen, found = watched(*oscillator(inertia, stiffness))
    assert found[1:, 0].mean() == pytest.approx(math.pi * math.sqrt(inertia / stiffness), rel=0.01)
    assert seen.last[-1].inertia == pytest.approx(inertia, rel=0.03)
    assert seen.last[-2].inertia == pytest.approx(inertia, rel=0.03)


def test_moved_by_somebody_else_it_seems_as_heavy_as_the_torque_explains() -> None:
    """A quarter of the spring's torque at the same motion seems a quarter of the mass."""
    positions, torques = oscillator(0.012, 5.0)
    seen, _ = watched(positions, [0.25 * torque for torque in torques])
    assert seen.last[-1].inertia == pytest.approx(0.003, rel=0.03)


def test_what_was_forgotten_does_not_count() -> None:
    seen, _ = watched(cosine(5.0, 0.1, 1.0))
    assert len(seen.last) == 4
    seen.forget()
    assert len(seen.last) == 0
    assert not lasts(seen.last, TUNING)
    for position in 3.0 + cosine(5.0, 0.1, 0.25):
        seen.update(position, 0.0, PERIOD)
    assert len(seen.last) == 2
    assert seen.last[-1].amplitude == pytest.approx(0.1, rel=0.01), "not the way to the new place"


moves = st.floats(-0.5, 0.5, allow_subnormal=False)
spans = st.integers(1, 5)


@given(st.lists(st.tuples(moves, moves, spans), max_size=200), st.sampled_from([0.0, COUNT]))
def test_durations_sum_to_the_time_between_the_first_turning_point_and_the_last(
    samples: list[tuple[float, float, float]], count: float
) -> None:
    seen = HalfCycles(PERIOD, count, TUNING)
    total = elapsed = 0.0
    turns = None
    for position, torque, periods in samples:
        span = periods * PERIOD
        elapsed += span
        ended = seen.update(position, torque, span)
        if ended:
            if turns is None:
                turns = elapsed - seen.elapsed - seen.last[-1].duration
            total += seen.last[-1].duration
            assert total == pytest.approx(elapsed - seen.elapsed - turns, abs=1e-9)
            assert seen.last[-1].duration > 0.0
            assert seen.last[-1].amplitude > 0.0
            assert seen.interval == seen.last[-1].duration
            assert all(map(math.isfinite, seen.last[-1]))


@pytest.mark.parametrize("count", [0.0, COUNT])
def test_a_small_motion_is_seen_soon_after_one_many_times_its_size(count: float) -> None:
    """What turns back by less than a part of the last motion is a ripple only for so long."""
    large = cosine(5.0, 0.5, 0.5, count)
    ripple = cosine(15.0, 0.03, 0.4, count)
    small = cosine(14.0, 0.02, 2.0, count)
    _, found = watched(np.concatenate([large, ripple, small]), count=count)
    assert found[-20:, 0] == pytest.approx(0.5 / 14.0, abs=1.01 * PERIOD)
    assert found[-20:, 1] == pytest.approx(0.02, abs=count + 1e-3)


def test_the_load_is_the_mean_over_two_cycles() -> None:
    """Pushes that alternate, as of a hand that taps, are no load."""
    positions = cosine(5.0, 0.1, 1.0, 0.0)
    steady, _ = watched(positions, [0.5] * len(positions))
    assert steady.load == pytest.approx(0.5)
    turns = [1.0 if (k // 200) % 2 else -1.0 for k in range(len(positions))]  # each cycle
    assert abs(watched(positions, turns)[0].load) < 0.1
