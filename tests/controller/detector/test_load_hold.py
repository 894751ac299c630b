"""What holds a load while the wall is softer: how much, up to where, and until when."""

import math

import numpy as np
import pytest

from haptic_wall.controller.detector.half_cycles import HalfCycles
from haptic_wall.controller.detector.load_hold import LoadHold
from haptic_wall.controller.detector.tuning import TUNING

STIFFNESS, LIMIT = 10.0, 4.0


def swung(place: float, amplitude: float, cycles: float = 3.2, friction: float = 0.0) -> HalfCycles:
    """The half-cycles of a swing at 5 Hz about a place, that the spring alone moves."""
    seen = HalfCycles(1e-3, 0.0, TUNING.half_cycles)
    for k in range(round(200 * cycles)):
        phase = math.tau * 5.0 * k * 1e-3
        away = place + amplitude * math.cos(phase)
        torque = np.clip(-STIFFNESS * away, -LIMIT, LIMIT) + friction * np.sign(-math.sin(phase))
        seen.update(away, float(torque), 1e-3)
    return seen


def holding(seen: HalfCycles, *, one_sided: bool = False) -> LoadHold:
    hold = LoadHold(seen, LIMIT, TUNING.hold, one_sided=one_sided)
    hold.begin(STIFFNESS, whole=True)
    return hold


@pytest.mark.parametrize("place", [0.2, -0.2, 0.05])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_the_load_is_the_mean_torque_of_whole_cycles(place: float, friction: float) -> None:
    hold = holding(swung(place, 0.1, friction=friction))
    assert hold.torque == pytest.approx(-STIFFNESS * place, abs=0.02)
    assert hold.acts(place, STIFFNESS, 0.25) == pytest.approx(0.75 * hold.torque)


def test_a_single_half_cycle_shows_no_load() -> None:
    assert holding(swung(0.2, 0.1, cycles=0.6)).torque == 0.0


def test_a_motion_before_a_pause_is_no_part_of_the_load() -> None:
    seen = swung(-0.3, 0.1)
    seen.forget()
    for k in range(240):
        away = 0.2 + 0.1 * math.cos(math.tau * 5.0 * k * 1e-3)
        seen.update(away, -STIFFNESS * away, 1e-3)
    assert seen.known == 2
    assert holding(seen).torque == pytest.approx(-2.0, abs=0.02)


def test_a_load_that_has_just_changed_sides_is_not_held() -> None:
    seen = swung(0.3, 0.1)
    for k in range(220):
        away = -0.1 + 0.1 * math.cos(math.tau * 5.0 * (k + 40) * 1e-3)
        seen.update(away, -STIFFNESS * away, 1e-3)
    assert holding(seen).torque == 0.0


def test_a_shaft_that_swings_about_the_surface_again_has_no_load_to_be_held() -> None:
    """Somebody pushed in the last cycle, and has let go: the spring does not carry the mean."""
    seen = swung(0.0, 0.1)
    assert abs(seen.mean_torque()) < 0.02
    pushed = HalfCycles(1e-3, 0.0, TUNING.half_cycles)
    for k in range(640):
        away = 0.1 * math.cos(math.tau * 5.0 * k * 1e-3)
        pushed.update(away, -STIFFNESS * away - 2.0, 1e-3)
    assert pushed.mean_torque() == pytest.approx(-2.0, abs=0.02)
    assert abs(holding(pushed).torque) == pytest.approx(0.25, abs=0.02)


def test_it_ends_a_quarter_of_the_swing_beyond_the_turning_points() -> None:
    hold = holding(swung(0.2, 0.1))
    assert hold.reach == pytest.approx(0.075, abs=1e-3)
    assert hold.acts(0.1, STIFFNESS, 0.25) == hold.acts(0.3, STIFFNESS, 0.25)
    assert abs(hold.acts(0.0, STIFFNESS, 0.25)) < abs(hold.acts(0.1, STIFFNESS, 0.25))
    assert hold.acts(-0.2, STIFFNESS, 0.25) == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_whoever_passes_the_surface_has_taken_the_load_away(side: float) -> None:
    clear, near = holding(swung(0.2 * side, 0.1)), holding(swung(0.1 * side, 0.1))
    assert clear.left(-0.001 * side)
    assert not clear.left(0.001 * side)
    assert not near.left(-0.001 * side), "the load itself swings there"
    assert holding(swung(0.1 * side, 0.1), one_sided=True).left(0.0), "outside nothing is held"


def test_a_load_has_gone_where_the_wall_pushes_with_less_than_half_of_it() -> None:
    hold = holding(swung(0.2, 0.1))
    assert not hold.gone(-1.1)
    assert hold.gone(-0.9)
    assert hold.gone(1.5)
