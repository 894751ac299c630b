"""The detector on simulated walls: kicked above and below their limits; and rounded torques."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pytest

from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.experiments.maps.loop import Wall
from haptic_wall.controller.experiments.maps.walls import Loop, wall_of
from haptic_wall.controller.laws.wall import Wall as Rendered
from haptic_wall.controller.runtime.session_result import Result
from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.truth import TrueServo
from tests.cases import sampled
from tests.support.simulated_run import session
from tests.support.truth import COUNT
from tests.typed import not_none

M, B_SERVO, T = 0.011951, 0.011692, 1e-3
DELAYS = (0, 1, 2, 5, 10)
LOOK = 400
"""Samples after which it is looked whether a growing motion is large enough"""


class Stiff(NamedTuple):
    """A two-sided wall with its stiffness."""

    wall: Wall
    stiffness: float
    """[N·m/rad]"""


def stiff(share: float, virtual_damping: float, whole: int) -> Stiff:
    """A wall at a share of its exact limit, with a delay of whole periods."""
    limit = float(critical_stiffness(M, B_SERVO, virtual_damping, T, whole * T))
    servo = TrueServo(M, B_SERVO, torque_limit=math.inf)
    wall = wall_of(servo, period=T, delay=whole * T, virtual_damping=virtual_damping)
    return Stiff(wall, share * limit)


def some_walls(share: float) -> list[Stiff]:
    """Walls of several delays and dampings, at a share of their exact limit."""
    return [stiff(share, damping, whole) for whole in DELAYS for damping in (0.0, 0.05, 0.2)]


def wrong_beliefs(count: int) -> list[float]:
    """The inertia is believed a fifth too high or too low."""
    beliefs: list[float] = np.random.default_rng(5).choice([0.8, 1.2], count).tolist()
    return beliefs


def kicked(
    walls: list[Stiff], kick: float, cycles: float, until: float = math.inf
) -> Iterator[FloatArray]:
    """Release servos at rest, ``kick`` from the wall; the courses as ``Loop.run`` returns them.

    Args:
        walls: The walls.
        kick: > 0 [rad].
        cycles: Oscillations of the slowest undamped spring to record.
        until: Amplitude in kicks (but at least 20 counts) at which the recording may end.
    """
    slowest = max(math.tau * math.sqrt(one.wall.moved / one.stiffness) for one in walls) / T
    periods = int(cycles * slowest + 500)
    for one in walls:
        loop = Loop(one.wall, one.stiffness, kick)
        parts: list[FloatArray] = []
        enough = max(until * kick, 20.0 / one.wall.counts)
        while loop.k < periods and not (parts and np.abs(parts[-1][:, 0]).max() > enough):
            parts.append(loop.run(min(LOOK, periods - loop.k)))
        yield np.concatenate(parts)


def first_alarm(one: Stiff, course: FloatArray, belief: float) -> int | None:
    """The sample of the first alarm of a watch that may only report; None: there is none.

    Args:
        one: The simulated wall.
        course: Its record.
        belief: Factor on the inertia: the believed one is wrong.
    """
    inertia = one.wall.body.inertia * belief
    watch = Watch(WatchSettings(T, COUNT, side=0, light=inertia, heavy=inertia))
    law = Rendered(one.stiffness, one.wall.virtual_damping, 0.0, "both")
    _, _, measured, torques = course.T
    positions = np.rint(measured / COUNT) * COUNT
    for k, (position, torque) in enumerate(zip(positions.tolist(), torques.tolist(), strict=True)):
        watch.sample(position, law, math.nan, 1)
        watch.sent(torque)
        if watch.alarm:
            return k
    return None


def test_growth_is_noticed_while_somebody_leans_on_the_wall() -> None:
    # A steady push moves the middle of the motion 30 counts off the surface; it pays for nothing.
    one = stiff(1.3, 0.05, 2)
    course = Loop(one.wall, one.stiffness, -20 * COUNT).run(1500, 30 * COUNT * one.stiffness)
    first = not_none(first_alarm(one, course, 1.0))
    # It began 50 counts from that middle.
    assert np.abs(course[:first, 0] / COUNT - 30.0).max() < 3.0 * 50.0


@pytest.mark.parametrize("share", sampled([1.2, 1.5, 2.5], 3))
def test_walls_above_their_limit_are_noticed_while_they_grow(share: float) -> None:
    walls, kick = some_walls(share), 30 * COUNT
    reached = []
    courses = kicked(walls, kick, 60.0, until=3.0)
    for one, course, belief in zip(walls, courses, wrong_beliefs(len(walls)), strict=True):
        first = not_none(first_alarm(one, course, belief))
        reached.append(np.abs(course[: first + 1, 0]).max() / kick)
    # The fastest one grows by half in each half-cycle.
    assert float(np.median(reached)) < 2.1
    assert max(reached) < 12.0


def test_motion_that_dies_is_no_alarm() -> None:
    walls = some_walls(0.7)
    courses = kicked(walls, 60 * COUNT, 6.0)
    for one, course, belief in zip(walls, courses, wrong_beliefs(len(walls)), strict=True):
        assert first_alarm(one, course, belief) is None


# Torques that are rounded to the servo's unit

ROUNDED = (
    *("wall.side=both", "servo.hand=none", "servo.coulomb=0"),
    "safety.on_oscillation=trip",
)
UNIT = 0.0048


@pytest.mark.parametrize(
    ("counts", "unit", "friction", "stiffness", "wall_damping", "kick"),
    sampled(
        [
            (0, UNIT, 0.0117, 1e6, 0.02, 0.001),  # as much as the guard allows
            (0, 4.0 * UNIT, B_SERVO, 1e6, 0.02, 0.001),
            (0, 4.0 * UNIT, B_SERVO, 1e6, 0.0, 0.001),
            (0, UNIT, 0.002, 1.0, 0.002, 0.7 * UNIT),
            (4096, UNIT, 0.0, 0.1, 0.002, 7.0 * UNIT),  # softer than one unit for each count
        ],
        5,
    ),
)
def test_what_the_rounding_of_torques_keeps_up_is_no_alarm(
    counts: int, unit: float, friction: float, stiffness: float, wall_damping: float, kick: float
) -> None:
    """A torque unit moves a stable wall's spring by unit / K; about so much goes on for ever."""
    result = rounded_run(
        f"servo.counts_per_rev={counts}",
        f"servo.torque_step={unit}",
        f"servo.damping={friction}",
        f"wall.stiffness={stiffness}",
        f"wall.damping={wall_damping}",
        f"servo.kick={kick}",
    )
    assert result.stop_reason == "duration"
    assert not_none(result.oscillation)["first_alarm_s"] is None


def test_the_rounding_of_torques_hides_no_unstable_wall() -> None:
    alarms = []
    for unit in (0.0, UNIT):
        result = rounded_run(
            *("servo.counts_per_rev=0", f"servo.torque_step={unit}", "servo.delay=0.006"),
            *("model.delay=0.002", "wall.stiffness=30", "servo.kick=0.02"),
        )
        assert result.stop_reason == "trip:oscillation"
        alarms.append(not_none(result.oscillation))
    plain, rounded = alarms
    half_cycle = 0.5 / rounded["frequency_hz"]
    assert rounded["first_alarm_s"] <= plain["first_alarm_s"] + half_cycle


def rounded_run(*sets: str) -> Result:
    return session("simulated", *ROUNDED, *sets, duration=8.0)[0]
