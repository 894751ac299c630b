"""A suspicion belongs to the motion that raised it."""

import math

import pytest

from haptic_wall.controller.detector.backstop import BackstopSettings
from haptic_wall.controller.detector.own_motion import OwnMotion

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
