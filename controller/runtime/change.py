"""A change of a running wall, as the loop gets it: law, decisions, delay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from haptic_wall.controller.detector.own_motion import OwnMotion
from haptic_wall.controller.detector.watch import WatchSettings
from haptic_wall.controller.guard.guard import Decision
from haptic_wall.controller.laws.wall import Law
from haptic_wall.hw.servo import Bus, Facts


@dataclass(frozen=True, slots=True)
class KnownServo:
    """The facts of a servo that another process has opened."""

    facts: Facts
    bus: Bus | None
    simulated: bool
    """The loop runs on the simulated clock"""


@dataclass(slots=True)
class Change:
    """All that the loop needs for a change; made outside of it."""

    number: int
    """Counts the changes of a run, from 1"""
    config: list[str]
    """The configuration with the change, as JSON, in parts"""
    law: Law | None
    """Rendered from then on, its position without the start's; None: the same, with other gains"""
    watch: WatchSettings
    moved: bool
    """The law is another one, or elsewhere"""
    softer: bool
    """Nothing is asked for but a lower stiffness"""
    decisions: list[Decision]
    """Each once"""
    bins: list[list[int]]
    """The index of each bin's decision, as ``GainSchedule`` takes the decisions"""
    injected: list[float]
    """``most_injected`` of the bins"""
    steps: int
    """Of the inserted delay [periods]"""
    highest: float = 0.0
    """Largest stiffness of the decisions [N·m/rad]"""
    rows: Sequence[Sequence[Decision]] = ()
    """The decisions of the bins; made in the loop's process, as the next"""
    placed: bool = False
    """The law's position counts from the start, where ``wall.reference`` says so; likewise"""
    own: OwnMotion | None = None
    """The backstop for a law that has moved"""

    def complete(self) -> None:
        """Make the parts that are not sent to the loop's process."""
        decisions = self.decisions
        self.rows = [[decisions[index] for index in row] for row in self.bins]
        watch = self.watch
        if self.moved and watch.backstop is not None:
            self.own = OwnMotion(watch.backstop, watch.bounces, watch.side, watch.elongation)
