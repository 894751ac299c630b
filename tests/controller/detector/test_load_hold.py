"""What holds a load while the wall is softer: how much, up to where, and until when."""

import math

import numpy as np
import pytest

from haptic_wall.controller.detector.half_cycles import HalfCycles
from haptic_wall.controller.detector.load_hold import LoadHold
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.tuning import TUNING

STIFFNESS, LIMIT = 10.0, 4.0


def swung(place: float, amplitude: float, cycles: float = 3.2, friction: float = 0.0) -> HalfCycles:
    """The half-cycles of a swing at 5 Hz about a place, that the spring alone moves."""
    seen = HalfCycles(1e-3, 0.0, TUNING)
    for k in range(round(200 * cycles)):
        phase = math.tau * 5.0 * k * 1e-3
        away = place + amplitude * math.cos(phase)
        torque = np.clip(-STIFFNESS * away, -LIMIT, LIMIT) + friction * np.sign(-math.sin(phase))
        seen.update(away, float(torque), 1e-3)
    return seen


def holding(seen: HalfCycles, *, one_sided: bool = False) -> LoadHold:
    hold = LoadHold(seen, WatchSettings(1e-3, side=int(one_sided), torque_limit=LIMIT))
    hold.begin(STIFFNESS)
    return hold


@pytest.mark.parametrize("place", [0.2, -0.2, 0.05])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_the_load_is_the_mean_torque_of_whole_cycles(place: float, friction: float) -> None:
    hold = holding(swung(place, 0.1, friction=friction))
    assert hold.torque == pytest.approx(-STIFFNESS * place, abs=0.02)
    assert hold.acts(place, STIFFNESS, 0.25) == pytest.approx(0.75 * hold.torque)


def test_it_ends_a_quarter_of_the_swing_beyond_the_turning_points() -> None:
    hold = holding(swung(0.2, 0.1))
    assert hold.reach == pytest.approx(0.075, abs=1e-3)
    assert hold.deep == pytest.approx(0.325, abs=1e-3)
    assert hold.acts(0.1, STIFFNESS, 0.25) == hold.acts(0.3, STIFFNESS, 0.25)
    assert abs(hold.acts(0.0, STIFFNESS, 0.25)) < abs(hold.acts(0.1, STIFFNESS, 0.25))
    assert hold.acts(-0.2, STIFFNESS, 0.25) == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_whoever_passes_the_surface_has_taken_the_load_away(side: float) -> None:
    clear, near = holding(swung(0.2 * side, 0.1)), holding(swung(0.1 * side, 0.1))
    assert clear.left(-0.001 * side, soft=False)
    assert not clear.left(0.001 * side, soft=False)
    assert not clear.left(-0.001 * side, soft=True), "the wall does not come back there"
    assert not near.left(-0.001 * side, soft=False), "the load itself swings there"
    outside = holding(swung(0.1 * side, 0.1), one_sided=True)
    assert outside.left(0.0, soft=True), "outside nothing is held"


def followed(
    hold: LoadHold, away: float, torque: float, seconds: float, *, returning: bool = False
) -> float:
    """What is held after a time at rest, on a wall with a sixteenth of its stiffness [N·m]."""
    for _ in range(round(1e3 * seconds)):
        hold.follow(away, torque, 1e-3, STIFFNESS, 1 / 16, ended=False, returning=returning)
    return hold.torque


def at_rest(seen: HalfCycles, place: float) -> None:
    for _ in range(400):
        seen.update(place, -STIFFNESS * place, 1e-3)


@pytest.mark.parametrize("eased", [-0.8, -1.8, 0.4])
def test_a_load_at_rest_that_has_changed_is_held_as_it_is_now(eased: float) -> None:
    """Less than half of it was dropped at once, and fell through a wall at a sixteenth."""
    hold = holding(seen := swung(0.2, 0.1))
    at_rest(seen, 0.1)
    assert followed(hold, 0.1, eased, 0.1) == pytest.approx(-2.0, abs=0.05), "it may move on"
    assert abs(followed(hold, 0.1, eased, 3.0) - eased) < 0.03


@pytest.mark.parametrize("scale", [1 / 16, 1 / 64])
def test_a_heavy_load_that_begins_to_swing_slowly_does_not_rest_where_it_turns(
    scale: float,
) -> None:
    """What is held followed the torque there, and fed the swing."""
    hold = holding(seen := swung(0.2, 0.1))
    last, rate = hold.torque, 8.0 * math.sqrt(scale)
    for k in range(round(1e3 * math.pi / rate)):
        swing = 0.2 * math.cos(rate * k * 1e-3)
        torque = -2.0 - scale * STIFFNESS * swing
        ended = seen.update(0.2 + swing, torque, 1e-3)
        hold.follow(0.2 + swing, torque, 1e-3, STIFFNESS, scale, ended=ended, returning=True)
    assert abs(hold.torque - last) < 0.02
