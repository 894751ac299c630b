"""Scripted operator models: a soft spring and damper toward a piecewise linear reference.

An operator does not sense what it touches; its script is relative to the wall (depth: positive
inside). The reference first moves from the servo's position to the first depth of the script, so
that the run does not start with an impact. It then repeats the script for ever.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import NamedTuple, Protocol

from haptic_wall.hw.hand import EVERY_NS, Grasp
from haptic_wall.hw.plant.step import Hand
from haptic_wall.hw.truth import HandName, TrueServo

STIFFNESS = 4.0
"""Of a relaxed wrist, softer than any useful wall [N·m/rad]: 0.5 rad inside a wall of 15 N·m/rad it
makes 1.5 N·m, well above friction and below a servo's saturation"""
DAMPING = 0.2
"""[N·m·s/rad]: a wrist does not ring (ratio about 0.5 with 0.01 kg·m²)"""
LEAD_IN_S = 0.5
"""Least duration of the lead-in to the first depth of the script [s]"""
LEAD_IN_SPEED = 2.0
"""Largest speed of the lead-in [rad/s]"""
FOREVER_NS = 1 << 62
"""Later than every time [ns]"""


class OperatorModel(Protocol):
    """Interface of an operator model: a hand that moves a servo's output."""

    def pull(self, elapsed_ns: int) -> tuple[Hand, int]:
        """Return the hand at ``elapsed_ns``, and when its slope or grip changes [ns].

        Times count from the start.
        """


class Script(NamedTuple):
    """Depths in the wall over one period, joined by straight lines."""

    times_s: tuple[float, ...]
    """From 0 up, increasing; the last one is the period [s]"""
    depths: tuple[float, ...]
    """At those times [rad]; the last equals the first"""


SCRIPTS: dict[HandName, Script] = {
    # 0.64 rad/s: slowly in and out of the wall.
    "push": Script((0.0, 0.4, 1.65, 2.35, 3.6, 4.0), (-0.3, -0.3, 0.5, 0.5, -0.3, -0.3)),
    # 5 rad/s: a knock, then time to see what is left of it.
    "tap": Script((0.0, 0.3, 0.4, 0.5, 1.0), (-0.2, -0.2, 0.3, -0.2, -0.2)),
    "lean": Script((0.0, 4.0), (0.5, 0.5)),
}


def held_by(grasp: Grasp, now_ns: int) -> tuple[Hand, int]:
    """Return a person's hand at a time of the clock, and when its slope or grip changes [ns]."""
    if now_ns >= grasp.until_ns:
        return Hand(reference=grasp.target), FOREVER_NS
    arrives_ns = grasp.begin_ns + EVERY_NS
    moving = now_ns < arrives_ns
    slope = grasp.slope if moving else 0.0
    hand = Hand(grasp.stiffness, grasp.damping, grasp.position(now_ns), slope)
    return hand, arrives_ns if moving else grasp.until_ns


class ScriptedOperator:
    """The reference of an operator over time."""

    def __init__(self, script: Script, position: float, origin: float, direction: int) -> None:
        """Place the script at the wall.

        Args:
            script: Depths over time.
            position: Position of the servo at the start [rad].
            origin: Origin of the wall [rad].
            direction: +1: depths count upward; -1: downward.
        """
        self._knots_ns = [round(time * 1e9) for time in script.times_s]
        self._period_ns = self._knots_ns[-1]
        self._origin = position
        self._references = [origin + direction * depth for depth in script.depths]
        way = self._references[0] - position
        lead_in_s = max(LEAD_IN_S, abs(way) / LEAD_IN_SPEED)
        self._lead_in_ns = round(lead_in_s * 1e9)
        self._lead_in_slope = way / lead_in_s

    def pull(self, elapsed_ns: int) -> tuple[Hand, int]:
        """Return the hand at ``elapsed_ns``, and when its slope changes [ns since the start]."""
        since_ns = elapsed_ns - self._lead_in_ns
        if since_ns < 0:
            slope = self._lead_in_slope
            reference = self._origin + slope * elapsed_ns * 1e-9
            return Hand(STIFFNESS, DAMPING, reference, slope), self._lead_in_ns
        phase_ns = since_ns % self._period_ns
        index = bisect_right(self._knots_ns, phase_ns) - 1
        start_ns, end_ns = self._knots_ns[index : index + 2]
        before, after = self._references[index : index + 2]
        slope = (after - before) / ((end_ns - start_ns) * 1e-9)
        reference = before + slope * (phase_ns - start_ns) * 1e-9
        return Hand(STIFFNESS, DAMPING, reference, slope), elapsed_ns - phase_ns + end_ns


def operator_of(true: TrueServo) -> ScriptedOperator | None:
    """Return the operator model that moves this simulated servo; None: no operator."""
    if true.hand == "none":
        return None
    return ScriptedOperator(
        SCRIPTS[true.hand], true.position, true.hand_origin, true.hand_direction
    )
