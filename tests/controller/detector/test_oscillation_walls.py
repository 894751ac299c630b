"""The detector on simulated walls: kicked above and below their limits, bouncing, under hands."""

import math

import numpy as np
import pytest

from haptic_wall.controller.detector.state import State
from haptic_wall.controller.experiments.maps.walls import Loop, wall_of
from haptic_wall.controller.runtime.session_result import Result
from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.hw.truth import TrueServo
from tests.cases import sampled
from tests.support.kicked_walls import (
    Stiff,
    Trace,
    handled,
    kicked,
    listen,
    steady_oscillation,
    trace_of,
)
from tests.support.operators import HANDS
from tests.support.simulated_run import session
from tests.support.truth import COUNT
from tests.typed import not_none

M, B_SERVO, T = 0.011951, 0.011692, 1e-3


def one_wall(
    stiffness: float, virtual_damping: float, one_sided: bool, whole: int = 2, b: float = B_SERVO
) -> Stiff:
    servo = TrueServo(M, b, torque_limit=math.inf)
    wall = wall_of(
        servo, period=T, delay=whole * T, virtual_damping=virtual_damping, one_sided=one_sided
    )
    return Stiff(wall, stiffness)


def pushed(one: Stiff, push: float, speed: float, periods: int) -> Trace:
    """A servo that comes with a speed, pushed steadily toward the wall; see ``Trace``."""
    return trace_of(Loop(one.wall, one.stiffness, -20 * COUNT, speed).run(periods, push))


def test_growth_is_noticed_while_somebody_leans_on_the_wall() -> None:
    # A steady push moves the middle of the motion 30 counts off the surface; it pays for nothing.
    limit = float(critical_stiffness(M, B_SERVO, 0.05, T, 2 * T))
    walls = one_wall(1.3 * limit, 0.05, one_sided=False)
    trace = pushed(walls, 30 * COUNT * walls.stiffness, 0.0, 1500)
    first = listen(walls, trace, 1.0, once=True).alarms[0]
    # It began 50 counts from that middle.
    assert np.abs(trace.position[:first] / COUNT - 30.0).max() < 3.0 * 50.0


DELAYS = (0, 1, 2, 5, 10)


def some_walls(share: float, *, one_sided: bool = False) -> list[Stiff]:
    """Two-sided walls of several delays and dampings, at a share of their exact limit."""
    every = [(n, damping) for n in DELAYS for damping in (0.0, 0.05, 0.2)]
    return [
        one_wall(
            share * float(critical_stiffness(M, B_SERVO, damping, T, n * T)), damping, one_sided, n
        )
        for n, damping in every
    ]


def wrong_beliefs(count: int) -> list[float]:
    """The inertia is believed a fifth too high or too low."""
    beliefs: list[float] = np.random.default_rng(5).choice([0.8, 1.2], count).tolist()
    return beliefs


@pytest.mark.parametrize("share", sampled([1.2, 1.5, 2.5], 3))
def test_walls_above_their_limit_are_noticed_while_they_grow(share: float) -> None:
    walls = some_walls(share)
    kick = np.full(len(walls), 30 * COUNT)
    reached = []
    for i, trace in enumerate(kicked(walls, kick, 60.0, until=3.0)):
        alarms = listen(walls[i], trace, wrong_beliefs(len(walls))[i], once=True).alarms
        assert alarms
        reached.append(np.abs(trace.position[: alarms[0] + 1]).max() / kick[i])
    # The fastest one grows by half in each half-cycle.
    assert float(np.median(reached)) < 2.1
    assert max(reached) < 12.0


def test_motion_that_dies_is_no_alarm() -> None:
    walls = some_walls(0.7)
    for i, trace in enumerate(kicked(walls, np.full(len(walls), 60 * COUNT), 6.0)):
        assert not listen(walls[i], trace, wrong_beliefs(len(walls))[i], once=True).alarms


@pytest.mark.whole
@pytest.mark.parametrize("hand", sampled([each for each in HANDS if each != "rhythm"], 4))
def test_hands_on_walls_below_their_limit_are_no_alarm(hand: str) -> None:
    """A hand in rhythm may raise the early alarm: only a probe tells it from a wall."""
    walls = some_walls(0.7)
    for i, trace in enumerate(handled(walls, hand, 6000, np.random.default_rng(8))):
        assert not listen(walls[i], trace, wrong_beliefs(len(walls))[i], once=False).alarms


@pytest.mark.whole
@pytest.mark.parametrize("hand", sampled(["rhythm", "tap"], 2))
def test_hands_that_come_back_to_a_wall_that_never_pulls_are_no_bouncing(hand: str) -> None:
    walls = some_walls(0.6, one_sided=True)
    for i, trace in enumerate(handled(walls, hand, 6000, np.random.default_rng(3))):
        assert not listen(walls[i], trace, wrong_beliefs(len(walls))[i], once=False).alarms


@pytest.mark.whole
@pytest.mark.parametrize("size", sampled([5.0, 40.0], 2))
def test_oscillation_at_the_torque_limit_is_sustained_and_measured(size: float) -> None:
    walls = some_walls(1.5)
    walls = [
        Stiff(one.wall._replace(limit=one.stiffness * size * COUNT), one.stiffness) for one in walls
    ]
    measured = 0
    for i, trace in enumerate(kicked(walls, np.full(len(walls), size * COUNT), 50.0)):
        cycle = int(2.0 * math.pi * math.sqrt(M / walls[i].stiffness) / T)
        truth = steady_oscillation(trace.position[-12 * cycle :], T)
        if truth is None:
            continue
        watch = listen(walls[i], trace, 1.0, once=False).watch
        assert watch.state >= State.SUSTAINED
        assert watch.frequency_hz == pytest.approx(truth[0], rel=0.05)
        assert watch.amplitude == pytest.approx(truth[1], rel=0.2)
        measured += 1
    assert measured >= 5


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
