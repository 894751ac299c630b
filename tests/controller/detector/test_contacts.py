"""Contacts of made-up motions with a one-sided wall: duration, depth and apparent inertia."""

import math
from collections.abc import Iterable, Iterator

import pytest

from haptic_wall.controller.detector.contacts import Contacts

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
) -> Iterator[tuple[float, float]]:
    """A mass that falls onto a spring and comes back; yields depth and torque, at each sample.

    Args:
        stiffness: K [N·m/rad].
        speed: Speed of the first entry [rad/s].
        times: Contacts to see.
        damping: B of the wall [N·m·s/rad].
        lag: Periods by which the torque comes late: it then gives energy.
        gravity: Constant torque toward the wall, over the inertia; brings it back [rad/s²].
    """
    depth, velocity, seen, inside = -0.5 * speed * PERIOD, speed, 0, False
    late = [0.0] * (lag + 1)
    before = 0.0
    for _ in range(20_000):
        if seen == times:
            return
        yield depth, before
        if inside and depth <= 0.0:
            seen += 1
        inside = depth > 0.0
        before = min(-stiffness * depth - damping * velocity, 0.0) if inside else 0.0
        late = [*late[1:], before]
        acceleration = late[0] / INERTIA + gravity
        depth += velocity * PERIOD + 0.5 * acceleration * PERIOD * PERIOD
        velocity += acceleration * PERIOD


def watched(samples: Iterable[tuple[float, float]], count: float = 0.0) -> Contacts:
    seen = Contacts(count)
    for depth, torque in samples:
        seen.update(depth, torque, PERIOD)
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


@pytest.mark.parametrize("depth", [0.5, 1.0])
def test_a_touch_of_a_count_is_no_contact(depth: float) -> None:
    seen = watched([(-COUNT, 0.0), (depth * COUNT, 0.0)] * 20 + [(-COUNT, 0.0)], COUNT)
    assert len(seen.last) == 0


def test_on_an_encoder_the_surface_itself_is_outside() -> None:
    depths = [-2.0, 0.0, 0.0, 3.0, 5.0, 3.0, 0.0, 0.0, -2.0]
    seen = watched([(depth * COUNT, -max(depth, 0.0)) for depth in depths], COUNT)
    assert [one.duration for one in seen.last] == pytest.approx([3 * PERIOD])


@pytest.mark.parametrize(("lag", "damping", "gaining"), [(8, 0.0, 4), (0, 0.02, 0)])
def test_contacts_left_clearly_faster_than_entered_are_counted(
    lag: int, damping: float, gaining: int
) -> None:
    samples = bounces(30.0, 1.5, 5, lag=lag, damping=damping, gravity=20.0)
    assert watched(samples).gaining >= gaining
    if not gaining:
        assert watched(samples).gaining == 0
