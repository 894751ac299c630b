"""Changes that an attacker makes while a hand swings the shaft: what the shaft gets from them."""

import math
from collections.abc import Sequence

import pytest

from haptic_wall.controller.runtime.changeover import Obstacle
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.hand import EVERY_NS, FASTEST, Grasp
from tests.cases import sampled
from tests.support.changed_walls import Asked, ChangedRun, injected

MOST_J = 1e-3
STOPS_S = 0.8
"""When the hand has stopped [s]"""
GRIP = 20.0
"""Stiffness of the spring between hand and shaft [N·m/rad]"""


class Hand:
    """A hand that swings the shaft to and fro, and then holds it still.

    Args:
        amplitude: Of the hand [rad].
        hertz: [Hz]
    """

    def __init__(self, amplitude: float, hertz: float) -> None:
        self._rate = math.tau * hertz
        self._amplitude = min(amplitude, FASTEST / self._rate)

    def of(self, _axis: int) -> "Hand":
        """Return the hand on the only shaft."""
        return self

    def look(self, now_ns: int) -> Grasp:
        """Return how the hand holds the shaft at a time [ns]."""
        angle = self._rate * min(now_ns * 1e-9, STOPS_S)
        place = self._amplitude * math.sin(angle)
        if now_ns > STOPS_S * 1e9:
            return Grasp(now_ns, now_ns + 1, place, place, GRIP)
        speed = self._amplitude * self._rate * math.cos(angle)
        target = place + speed * EVERY_NS * 1e-9
        return Grasp(now_ns, now_ns + EVERY_NS, place, target, GRIP)


def changed_at(
    tick: int, first: Sequence[str], change: Sequence[str], amplitude: float, hertz: float
) -> tuple[Asked, float]:
    """Change a wall while the shaft is swung; return the change, and the energy it gave [J]."""
    sets = ("loop.clock=simulated", "servo.hand=none", "safety.max_speed=1000", *first)
    left = [tuple(change)]

    def ask(row: int, _now: Config, _position: float) -> Sequence[str]:
        return left.pop() if left and row >= tick else ()

    hand = Hand(amplitude, hertz)
    run = ChangedRun(load_config("simulated", sets).config, ask, 5000, hand=hand)
    _, rows = run.run(2.0)
    asked = run.asked[0]
    return asked, injected(run, rows, asked) if asked.row >= 0 else 0.0


DAMPER = "wall.law=damper", "wall.damping=0.2"
FRICTION = (
    "wall.law=friction",
    "wall.friction=0.041",
    "wall.stiffness=25",
    "wall.damping=0.187",
)
SUM = (
    "wall.law=sum",
    "wall.parts=[{law: stops, low: -0.44, high: 0.44, share: 3}, {law: detents, count: 39}]",
    "wall.stiffness=13.2",
    "wall.damping=0.133",
    "delay.steps=50",
)


@pytest.mark.parametrize("tick", sampled([310, 340, 370, 400], 2))
def test_a_longer_delay_of_a_damper_waits_for_a_slow_shaft(tick: int) -> None:
    asked, energy = changed_at(tick, DAMPER, ("delay.steps=20",), 0.6, 3.0)
    assert asked.row >= 1e3 * STOPS_S and asked.obstacle is Obstacle.DELAY
    assert energy <= MOST_J


@pytest.mark.parametrize(
    ("first", "change", "amplitude", "hertz", "tick"),
    [
        (
            FRICTION,
            ("wall.law=wall", "wall.position=0.46", "delay.steps=20"),
            0.8756193428878896,
            3.738229774197739,
            339,
        ),
        (
            SUM,
            ("wall.position=-0.152", "delay.steps=3"),
            0.565007263508559,
            2.517783392050179,
            391,
        ),
    ],
    ids=["friction to a wall", "a sum that moves"],
)
def test_another_delay_with_another_law_gives_the_shaft_no_energy(
    first: tuple[str, ...], change: tuple[str, ...], amplitude: float, hertz: float, tick: int
) -> None:
    _, energy = changed_at(tick, first, change, amplitude, hertz)
    assert energy <= MOST_J


def test_a_change_waits_until_the_torques_of_the_one_before_have_acted() -> None:
    """Where the ring holds torques of several laws, nobody knows what the shaft gets."""
    sets = ("loop.clock=simulated", "servo.hand=none", "delay.steps=30", "wall.position=0.5")
    left = [("wall.position=0.6",), ("wall.position=0.7",)]

    def ask(row: int, _now: Config, _position: float) -> Sequence[str]:
        return left.pop(0) if left and row > 300 else ()

    run = ChangedRun(load_config("simulated", sets).config, ask)
    run.run(1.0)
    first, second = run.asked
    assert second.row - first.row > 30
