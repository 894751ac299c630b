"""The backstop under motions that go on whatever the wall does: a hand makes them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from haptic_wall.controller.detector.backstop import Backstop
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.laws.wall import held_torque

COUNT = math.tau / 4096
SETTINGS = WatchSettings(
    period=1e-3,
    position_step=COUNT,
    answer="reduce",
    light=0.006,
    heavy=0.02,
    torque_limit=4.1,
    rest_torque=0.1,
)


def swing(own: Backstop, amplitude: float, seconds: float, hertz: float = 5.0) -> None:
    """Swing about the surface of a wall with 10 N·m/rad; an amplitude of 0 is rest."""
    for k in range(round(seconds * 1e3)):
        away = amplitude * math.sin(math.tau * hertz * k * 1e-3)
        away = round(away / COUNT) * COUNT
        own.update(away, -10.0 * away, 1e-3, 10.0)


def held(own: Backstop, away: float) -> float:
    now = own.wall.derating
    return held_torque(now.carried, now.carried_to, away, 10.0, now.scale)


def leaned_on(own: Backstop, place: float, amplitude: float, seconds: float) -> list[float]:
    """Somebody moves the shaft about a place deep in the wall, whatever it does: all scales."""
    scales = []
    for k in range(round(seconds * 1e3)):
        away = place + amplitude * math.sin(math.tau * 5.0 * k * 1e-3)
        away = round(away / COUNT) * COUNT
        torque = -10.0 * own.wall.derating.scale * away + held(own, away)
        own.update(away, torque, 1e-3, 10.0)
        scales.append(own.wall.derating.scale)
    return scales


@pytest.mark.parametrize("side", [0, 1])
def test_a_wall_comes_back_to_somebody_who_leans_where_it_changes_no_torque(side: int) -> None:
    own = Backstop(replace(SETTINGS, side=side))
    scales = leaned_on(own, 0.2, 0.1, 2.0)
    assert (own.probes, own.hands, own.alarms) == (1, 1, 0)
    softer = scales.count(0.25) * 1e-3
    assert 0.1 < softer < 0.4, "for two half-cycles, and half of one"
    assert own.probed_s == pytest.approx(softer, abs=2e-3)


def test_a_load_that_goes_while_readings_are_lost_takes_its_motion_with_it() -> None:
    """The shaft has turned around and passed the surface between two samples."""
    own = Backstop(SETTINGS)
    for k in range(2000):
        away = round((0.2 + 0.1 * math.sin(math.tau * 5.0 * k * 1e-3)) / COUNT) * COUNT
        own.update(away, -10.0 * away, 1e-3, 10.0)
        if own.wall.derating.carried and k % 200 == 49:
            break
    own.update(-0.02, 0.0, 0.04, 10.0)
    assert own.wall.derating.carried == 0.0
    assert own.wall.derating.scale == 1.0
    swing(own, 0.0, 0.5)


@pytest.mark.parametrize(("side", "middle"), [(0, 0.0), (1, 0.2), (1, 0.0)])
def test_a_wall_that_is_moved_again_and_again_is_probed_all_the_same(
    side: int, middle: float
) -> None:
    """Else an oscillation would grow without an alarm while somebody turns the wall's knob."""
    own = Backstop(replace(SETTINGS, side=side))
    surface, torque, size, own_settings = 0.0, 0.0, 0.1, replace(SETTINGS, side=side)
    for k in range(2000):
        if k % 50 == 0:
            way = (2.0 if k % 100 else -2.0) * COUNT
            surface += way
            own.change(own_settings, way)
        position = middle + size * math.sin(math.tau * 5.0 * k * 1e-3)
        away = round(position / COUNT) * COUNT - surface
        own.update(away, torque, 1e-3, 10.0)
        torque = -10.0 * own.wall.derating.scale * (away if not side else max(away, 0.0))
        if own.probes:
            break
    assert own.probes == 1
    assert 0.4 < k * 1e-3 < 1.5


def test_where_it_may_not_act_it_neither_probes_nor_reduces() -> None:
    own = Backstop(replace(SETTINGS, answer="report"))
    swing(own, 0.1, 10.0)
    assert own.steady
    assert not own.alarm
    swing(own, 0.1, 1.0, 20.0)
    assert own.alarm, "no hand is so fast"
    assert own.probes == 0
    assert own.wall.derating.scale == 1.0


def test_a_hands_motion_is_probed_again_after_ten_seconds_or_if_it_goes_on_regularly() -> None:
    own = Backstop(SETTINGS)
    asked: list[int] = []
    for k in range(12_000):
        size = 0.1 * (1.0 + 0.01 * math.sin(k * 2e-3))
        away = round(size * math.sin(math.tau * 2.0 * k * 1e-3) / COUNT) * COUNT
        own.update(away, -10.0 * own.wall.derating.scale * away, 1e-3, 10.0)
        if own.probes > len(asked):
            asked.append(k)
    assert own.alarms == 0
    assert len(asked) > 1
    assert np.diff(asked).min() > 4_000, "twenty half-cycles"


@pytest.mark.parametrize("load", [1.2, 2.6])
def test_a_wall_that_bears_much_load_is_not_probed_but_ends_the_run_under_a_machine(
    load: float,
) -> None:
    own = Backstop(SETTINGS)
    for k in range(12_000):
        away = round((load / 10.0 + 0.1 * math.sin(math.tau * 5.0 * k * 1e-3)) / COUNT) * COUNT
        own.update(away, -10.0 * away, 1e-3, 10.0)
        if own.probes:
            break
    assert own.probes == (load < 0.6 * 4.1)
    assert own.failed == (load > 0.6 * 4.1)
