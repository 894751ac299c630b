"""Contacts of made-up motions with a one-sided wall: duration, depth and apparent inertia."""

import math
from collections.abc import Iterable, Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_wall.controller.detector.contacts import Contacts
from haptic_wall.controller.detector.regularity import lasts, same_period
from haptic_wall.controller.detector.tuning import TUNING
from tests.typed import not_none

PERIOD = 1e-3
COUNT = math.tau / 4096
INERTIA = 0.012


def bounces(
    stiffness: float,
    speed: float,
    times: int = 1,
    *,
    damping: float = 0.0,
    lag: int = 0,
    gravity: float = 2.0,
    count: float = 0.0,
) -> Iterator[tuple[float, float]]:
    """A mass that falls onto a spring and comes back; yields depth and torque, at each sample.

    Args:
        stiffness: K [N·m/rad].
        speed: Speed of the first entry [rad/s].
        times: Contacts to see.
        damping: B of the wall [N·m·s/rad].
        lag: Periods by which the torque comes late: it then gives energy.
        gravity: Constant torque toward the wall, over the inertia; brings it back [rad/s²].
        count: Count of the encoder [rad].
    """
    depth, velocity, seen, inside = -0.5 * speed * PERIOD, speed, 0, False
    late = [0.0] * (lag + 1)
    before = 0.0
    for _ in range(20_000):
        if seen == times:
            return
        shown = round(depth / count) * count if count else depth
        yield shown, before
        if inside and shown <= 0.0:
            seen += 1
        inside = shown > 0.0
        before = min(-stiffness * shown - damping * velocity, 0.0) if inside else 0.0
        late = [*late[1:], before]
        acceleration = late[0] / INERTIA + gravity
        depth += velocity * PERIOD + 0.5 * acceleration * PERIOD * PERIOD
        velocity += acceleration * PERIOD


def watched(
    samples: Iterable[tuple[float, float]], count: float = 0.0, span: float = PERIOD
) -> Contacts:
    seen = Contacts(count, TUNING)
    for depth, torque in samples:
        seen.update(depth, torque, span)
    return seen


@pytest.mark.parametrize("stiffness", [2.0, 10.0, 60.0])
@pytest.mark.parametrize("speed", [0.5, 3.0])
def test_a_bounce_lasts_half_a_cycle_of_the_spring(stiffness: float, speed: float) -> None:
    seen = watched(bounces(stiffness, speed, gravity=0.0))
    half = math.pi * math.sqrt(INERTIA / stiffness)
    assert len(seen.last) == 1
    assert seen.last[-1].duration == pytest.approx(half, abs=1.6 * PERIOD)
    assert seen.last[-1].amplitude == pytest.approx(speed * half / math.pi, rel=0.05)


@pytest.mark.parametrize("stiffness", [2.0, 10.0, 30.0])
def test_what_bounces_seems_as_heavy_as_it_is(stiffness: float) -> None:
    seen = watched(bounces(stiffness, 2.0, gravity=0.0))
    assert seen.last[-1].inertia == pytest.approx(INERTIA, rel=0.05)


def test_the_interval_is_from_exit_to_exit() -> None:
    """A throw with 2 rad/s at 2 rad/s² comes back after 2 s, and stays for half a cycle."""
    seen = watched(bounces(10.0, 2.0, 3))
    assert len(seen.last) == 3
    assert seen.interval == pytest.approx(2.0 + seen.last[-1].duration, rel=0.06)
    assert seen.last[-1].duration == pytest.approx(seen.last[-2].duration, rel=0.1)


def test_a_wall_that_gives_as_it_takes_repeats_and_one_that_damps_does_not() -> None:
    even = watched(bounces(10.0, 1.0, 5, gravity=20.0))
    assert lasts(even.last, TUNING)
    assert same_period(even.last, TUNING)
    assert not lasts(watched(bounces(10.0, 1.0, 5, gravity=20.0, damping=0.1)).last, TUNING)
    late = watched(bounces(10.0, 1.0, 5, gravity=20.0, lag=6))
    assert lasts(late.last, TUNING)
    assert late.last[3].amplitude > late.last[1].amplitude


@pytest.mark.parametrize("depth", [0.5, 1.0])
def test_a_touch_of_a_count_is_no_contact(depth: float) -> None:
    seen = watched([(-COUNT, 0.0), (depth * COUNT, 0.0)] * 20 + [(-COUNT, 0.0)], COUNT)
    assert len(seen.last) == 0


def test_a_start_inside_is_no_entry_but_ends_like_one() -> None:
    """Its first sample tells nothing of the time before."""
    seen = watched([(0.1, 0.0), (0.1, -1.0), (0.05, -1.0), (-0.1, -0.5)])
    assert len(seen.last) == 1
    assert seen.last[-1].duration == pytest.approx(2 * PERIOD)


@given(
    st.lists(
        st.tuples(st.floats(-0.5, 0.5, allow_subnormal=False), st.floats(-4, 4), st.integers(1, 4)),
        max_size=100,
    ),
    st.sampled_from([0.0, COUNT]),
)
def test_contacts_are_deeper_than_a_count_and_no_longer_than_what_passed(
    samples: list[tuple[float, float, int]], count: float
) -> None:
    seen = Contacts(count, TUNING)
    total = inside = 0.0
    last = None
    for depth, torque, periods in samples:
        span = periods * PERIOD
        if last is not None:
            total += span
            inside += span if depth > 0.0 else 0.0
        ended = seen.update(depth, torque, span)
        if ended:
            assert not_none(last) > 0.0 >= depth
            assert seen.last[-1].amplitude > count
            assert 0.0 < seen.last[-1].duration <= inside + 1e-12
            assert seen.last[-1].duration <= seen.interval + 1e-12
            assert all(map(math.isfinite, seen.last[-1]))
        last = depth
        assert seen.elapsed <= total + 5e-3


def test_a_bounce_that_lost_speed_does_not_speak_for_small_contacts_after_it() -> None:
    """They stay within the gate, so that nothing is known of their speeds."""
    seen = watched(bounces(60.0, 3.0, times=3, damping=0.2, count=COUNT), COUNT)
    for k in range(1500):
        if k < 30:  # out through the gate, so that the last gain is taken
            seen.update(-k * COUNT, 0.0, PERIOD)
        elif k == 30:
            assert seen.gain < -0.07
        else:
            depth = 30 * COUNT * math.sin(math.tau * 8.0 * k * PERIOD)
            seen.update(max(depth, -6 * COUNT), 0.0, PERIOD)
    assert len(seen.last) == 4
    assert abs(seen.gain) < 0.02


@pytest.mark.parametrize(("lag", "damping", "gaining"), [(8, 0.0, 4), (0, 0.02, 0)])
def test_contacts_left_clearly_faster_than_entered_are_counted(
    lag: int, damping: float, gaining: int
) -> None:
    samples = bounces(30.0, 1.5, 5, lag=lag, damping=damping, gravity=20.0)
    assert watched(samples).gaining >= gaining
    if not gaining:
        assert watched(samples).gaining == 0


def test_the_mean_torque_of_a_bounce_is_the_push_that_it_holds_up() -> None:
    gravity = 20.0
    seen = watched(bounces(30.0, 1.0, 4, gravity=gravity))
    assert seen.load == pytest.approx(-INERTIA * gravity, rel=0.05)
