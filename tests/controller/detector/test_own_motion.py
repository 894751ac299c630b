"""A suspicion belongs to the motion that raised it."""

import math

import pytest

from haptic_wall.controller.detector.backstop import Phase
from haptic_wall.controller.detector.backstop_settings import BackstopSettings
from haptic_wall.controller.detector.own_motion import OwnMotion
from tests.typed import not_none

COUNT = math.tau / 4096
SETTINGS = BackstopSettings(
    period=1e-3,
    position_step=COUNT,
    threshold=10 * COUNT,
    small=3 * COUNT,
    light=0.005,
    heavy=0.03,
    heaviest=0.02,
    rest_torque=0.1,
    torque_limit=4.1,
)


def swing(own: OwnMotion, amplitude: float, seconds: float, hertz: float = 5.0) -> None:
    """Swing about the surface of a wall with 10 N·m/rad; an amplitude of 0 is rest."""
    for k in range(round(seconds * 1e3)):
        away = amplitude * math.sin(math.tau * hertz * k * 1e-3)
        away = round(away / COUNT) * COUNT
        own.update(away, -10.0 * away, 1e-3, 10.0)


@pytest.mark.parametrize("side", [0, 1])
def test_a_suspicion_lapses_where_the_motion_stops_before_it_is_probed(side: int) -> None:
    own = OwnMotion(SETTINGS, SETTINGS if side else None, side)
    swing(own, 2 * COUNT, 1.0)  # too small to be probed
    own.suspect()
    swing(own, 2 * COUNT, 1.0)
    assert own.suspected
    swing(own, 0.0, 0.5)
    assert not own.suspected
    swing(own, 0.1, 0.1)  # somebody moves the shaft to and fro, once
    swing(own, 0.0, 2.0)
    assert own.counts == (0, 0, 0, 0)


def test_a_suspicion_does_not_outlive_a_pause() -> None:
    own = OwnMotion(SETTINGS, None, 0)
    own.suspect()
    own.resume()
    assert not own.suspected


def leaned_on(own: OwnMotion, place: float, amplitude: float, seconds: float) -> list[float]:
    """Somebody moves the shaft about a place deep in the wall, whatever it does: all scales."""
    scales = []
    for k in range(round(seconds * 1e3)):
        away = place + amplitude * math.sin(math.tau * 5.0 * k * 1e-3)
        away = round(away / COUNT) * COUNT
        torque = -10.0 * own.scale * away + own.hold.acts(away, 10.0, own.scale)
        own.update(away, torque, 1e-3, 10.0)
        scales.append(own.scale)
    return scales


@pytest.mark.parametrize("side", [0, 1])
def test_a_wall_comes_back_to_somebody_who_leans_where_it_changes_no_torque(side: int) -> None:
    own = OwnMotion(SETTINGS, SETTINGS if side else None, side)
    scales = leaned_on(own, 0.2, 0.1, 2.0)
    assert own.counts == (1, 1, 0, 0)
    assert 0.1 < scales.count(0.25) * 1e-3 < 0.4, "for two half-cycles, and half of one"


def test_a_wall_comes_back_to_somebody_who_leans_more_than_before() -> None:
    own = OwnMotion(SETTINGS, None, 0)
    leaned_on(own, 0.2, 0.1, 0.72)
    assert own.scale == 0.25
    assert own.hold.torque == pytest.approx(-2.0, abs=0.05)
    assert own.reduced == (1.0, 1.0), "a probe takes nothing"
    leaned_on(own, 0.3, 0.04, 0.5)
    assert own.reduced == (0.25, 1.0), "it waits, and the report says so"
    assert 1.0 in leaned_on(own, 0.3, 0.04, 2.0)
    assert own.hold.torque == 0.0


def test_a_wall_that_contacts_have_softened_gets_no_torque_on_top() -> None:
    """What a probe of half-cycles holds is what that wall carries already, and comes slowly."""
    own = OwnMotion(SETTINGS, SETTINGS, 1)
    bounces = not_none(own._bounces)
    bounces.phase, bounces.stiffness_scale = Phase.REDUCED, 0.25
    held = 0.0
    for k in range(2000):
        away = round((0.2 + 0.1 * math.sin(math.tau * 5.0 * k * 1e-3)) / COUNT) * COUNT
        own.update(away, -10.0 * own.scale * away, 1e-3, 10.0)
        assert own.scale <= 0.25
        assert -0.6 < own.hold.torque <= held + 0.01
        assert abs(own.hold.torque - held) < 0.01
        held = own.hold.torque
    assert own.counts[0] == 1, "the motion is probed all the same"


@pytest.mark.parametrize(("side", "middle"), [(0, 0.0), (1, 0.2), (1, 0.0)])
def test_a_wall_that_is_moved_again_and_again_is_probed_all_the_same(
    side: int, middle: float
) -> None:
    """Else an oscillation would grow without an alarm while somebody turns the wall's knob."""
    own = OwnMotion(SETTINGS, SETTINGS if side else None, side)
    surface, torque, size = 0.0, 0.0, 0.1
    for k in range(2000):
        if k % 50 == 0:
            way = (2.0 if k % 100 else -2.0) * COUNT
            surface += way
            own.shift(way)
        position = middle + size * math.sin(math.tau * 5.0 * k * 1e-3)
        away = round(position / COUNT) * COUNT - surface
        own.update(away, torque, 1e-3, 10.0)
        torque = -10.0 * own.scale * (away if not side else max(away, 0.0))
        if own.counts[0]:
            break
    assert own.counts[0] == 1
    assert 0.4 < k * 1e-3 < 1.5


def test_it_tells_how_fast_the_shaft_turns_around() -> None:
    own = OwnMotion(SETTINGS, None, 0)
    assert not own.is_faster(math.inf)
    swing(own, 5 * COUNT, 0.5, 25.0)
    assert own.is_faster(0.022)
    assert not own.is_faster(0.018)
    swing(own, 0.0, 0.05)
    assert not own.is_faster(0.022)  # at rest: what comes next may be slow
