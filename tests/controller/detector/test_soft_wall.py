"""What holds a load while the wall is softer: how much, up to where, and until when."""

import math

import numpy as np
import pytest

from haptic_wall.controller.detector.half_cycles import HalfCycles
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.soft_wall import Phase, SoftWall
from haptic_wall.controller.laws.wall import held_torque

STIFFNESS, LIMIT = 10.0, 4.0


def swung(place: float, amplitude: float, friction: float = 0.0) -> HalfCycles:
    """The half-cycles of a swing at 5 Hz about a place, that the spring alone moves."""
    seen = HalfCycles(1e-3, 0.0)
    for k in range(640):
        phase = math.tau * 5.0 * k * 1e-3
        away = place + amplitude * math.cos(phase)
        torque = np.clip(-STIFFNESS * away, -LIMIT, LIMIT) + friction * np.sign(-math.sin(phase))
        seen.update(away, float(torque), 1e-3)
    return seen


def holding(seen: HalfCycles, *, one_sided: bool = False) -> SoftWall:
    wall = SoftWall(seen, WatchSettings(1e-3, side=int(one_sided), torque_limit=LIMIT))
    wall.take(0.0, 0.0, STIFFNESS, 0.0)
    wall.hold(moves=True)
    return wall


def acts(wall: SoftWall, away: float) -> float:
    """Return the torque that is added at a quarter of the stiffness [N·m]."""
    return held_torque(wall.derating.carried, wall.derating.carried_to, away, STIFFNESS, 0.25)


@pytest.mark.parametrize("place", [0.2, -0.2, 0.05])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_the_load_is_the_mean_torque_of_whole_cycles(place: float, friction: float) -> None:
    hold = holding(swung(place, 0.1, friction=friction))
    assert hold.derating.carried == pytest.approx(-STIFFNESS * place, abs=0.02)
    assert acts(hold, place) == pytest.approx(0.75 * hold.derating.carried)


def test_it_ends_a_quarter_of_the_swing_beyond_the_turning_points() -> None:
    hold = holding(swung(0.2, 0.1))
    assert hold.derating.carried_to == pytest.approx(0.075, abs=1e-3)
    assert hold.derating.soft_to == pytest.approx(0.325, abs=1e-3)
    assert acts(hold, 0.1) == acts(hold, 0.3)
    assert abs(acts(hold, 0.0)) < abs(acts(hold, 0.1))
    assert acts(hold, -0.2) == 0.0


def loses_load(wall: SoftWall, away: float, *, soft: bool = False) -> bool:
    wall.take(away, 0.0, STIFFNESS, 0.0)
    wall.phase = Phase.REDUCED if soft else Phase.PROBED
    return wall.loses_load()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_whoever_passes_the_surface_has_taken_the_load_away(side: float) -> None:
    clear, near = holding(swung(0.2 * side, 0.1)), holding(swung(0.1 * side, 0.1))
    assert not loses_load(clear, 0.001 * side)
    assert not loses_load(clear, -0.001 * side, soft=True), "the wall does not come back there"
    assert loses_load(clear, -0.001 * side)
    assert not loses_load(near, -0.001 * side), "the load itself swings there"
    outside = holding(swung(0.1, 0.1), one_sided=True)
    assert loses_load(outside, 0.0, soft=True), "outside nothing is held"


def followed(wall: SoftWall, away: float, torque: float, seconds: float) -> float:
    """What is held after a time at rest, on a wall with a sixteenth of its stiffness [N·m]."""
    wall.derating.scale, wall.phase = 1 / 16, Phase.REDUCED
    for _ in range(round(1e3 * seconds)):
        wall.take(away, torque, STIFFNESS, 0.0)
        wall.follow(1e-3, ended=False)
    return wall.derating.carried


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
    last, rate = hold.derating.carried, 8.0 * math.sqrt(scale)
    hold.derating.scale, hold.phase = scale, Phase.RETURNING
    for k in range(round(1e3 * math.pi / rate)):
        swing = 0.2 * math.cos(rate * k * 1e-3)
        torque = -2.0 - scale * STIFFNESS * swing
        ended = seen.update(0.2 + swing, torque, 1e-3)
        hold.take(0.2 + swing, torque, STIFFNESS, 0.0)
        hold.follow(1e-3, ended=ended)
    assert abs(hold.derating.carried - last) < 0.02
