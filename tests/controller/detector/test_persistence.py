import math
from types import SimpleNamespace
from typing import cast

import pytest

from haptic_wall.controller.detector.backstop_settings import BackstopSettings
from haptic_wall.controller.detector.evidence import Sighting
from haptic_wall.controller.detector.half_cycles import Repeated
from haptic_wall.controller.detector.known_hand import KnownHand
from haptic_wall.controller.detector.persistence import Persistence
from haptic_wall.controller.detector.tuning import TUNING

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


def seen(*half_cycles: tuple[float, float], settings: BackstopSettings = SETTINGS) -> Persistence:
    """Take half-cycles, each with its amplitude [rad] and duration [s]."""
    found = Persistence(settings)
    for last in range(len(half_cycles)):
        four = [half_cycles[max(last - k, 0)] for k in range(4)]
        motion: dict[str, float] = {"known": last + 1}
        for k, (amplitude, duration) in enumerate(four):
            name = f"_{k + 1}" if k else ""
            motion |= {f"amplitude{name}": amplitude, f"duration{name}": duration}
        at = sum(duration for _, duration in half_cycles[: last + 1])
        found.take(cast(Repeated, SimpleNamespace(**motion)), at)
    return found


def test_an_even_motion_makes_a_streak_and_grows_steady() -> None:
    even = [(0.1, 0.02)] * 60
    few = seen(*even[:10])
    assert few.streak == few.gentle == 10 - 3  # the first that can be compared is the fourth
    assert few.since == pytest.approx(0.02)
    assert not few.steady
    many = seen(*even)
    assert many.steady and not many.nearly_steady


def test_a_motion_that_changes_its_period_begins_anew() -> None:
    found = seen(*[(0.1, 0.02)] * 10, (0.1, 0.03))
    assert found.streak == found.gentle == 0
    assert found.since == pytest.approx(0.2 - 0.02)


def test_growth_is_regular_but_not_gentle() -> None:
    found = seen(*[(0.01 * 1.2**k, 0.02) for k in range(10)])
    assert found.streak == 7
    assert found.gentle == 0


@pytest.mark.parametrize(("kept", "dies"), [(0.99, True), (1.0, False), (1.01, False)])
def test_a_motion_that_loses_a_little_each_half_cycle_dies(kept: float, dies: bool) -> None:
    assert seen(*[(0.3 * kept**k, 0.02) for k in range(30)]).dies == dies


def test_less_than_the_encoders_rounding_is_no_loss() -> None:
    lost = [(20 * COUNT - 0.2 * COUNT * k / 30, 0.02) for k in range(30)]
    assert not seen(*lost).dies


def test_a_motion_that_must_not_be_probed_is_steady_where_it_is_regular() -> None:
    even = [(0.1 * 1.01**k, 0.02) for k in range(SETTINGS.unprobed + 4)]
    only_reports = BackstopSettings(
        **{name: getattr(SETTINGS, name) for name in SETTINGS.__slots__ if name != "acts"},
        acts=False,
    )
    assert seen(*even, settings=only_reports).steady
    assert not seen(*even[: SETTINGS.unprobed], settings=only_reports).steady


def test_a_motion_beyond_hands_goes_on_where_a_later_stretch_is_about_as_large() -> None:
    stretch = TUNING.backstop.beyond_half_cycles
    found = Persistence(SETTINGS)
    assert not any(found.goes_on(0.1, beyond_hands=True) for _ in range(2 * stretch - 1))
    assert found.goes_on(0.1, beyond_hands=True)
    assert not any(found.goes_on(0.05 * 0.5**k, beyond_hands=True) for k in range(2 * stretch))
    found.goes_on(0.1, beyond_hands=False)
    assert not any(found.goes_on(0.1, beyond_hands=True) for _ in range(2 * stretch - 1))


def test_a_hand_holds_off_probes_of_its_own_motion_for_a_while() -> None:
    hand = KnownHand(TUNING.backstop)
    motion = Sighting(0.2, 0.1, 0.01, 1.0)
    assert not hand.made(motion) and not hand.holds_off(motion)
    hand.found(motion, 1.5)
    assert hand.made(motion) and hand.holds_off(motion)
    late = motion._replace(at=1.5 + 1.01 * TUNING.backstop.held_off_s)
    assert hand.made(late) and not hand.recent(late) and not hand.holds_off(late)
    larger = motion._replace(amplitude=1.01 * TUNING.backstop.other_amplitude * 0.1)
    assert not hand.made(larger) and not hand.recent(larger)
    slower = motion._replace(cycle=0.2 * 1.01 * math.exp(TUNING.backstop.other_period))
    assert not hand.made(slower) and hand.recent(slower)
    hand.forget()
    assert not hand.made(motion)
