"""Describes a change of a running wall for the loop: law, decisions, delay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
    """Whether the loop runs on the simulated clock"""


@dataclass(slots=True)
class Change:
    """All data that the loop needs for a change; another process computes them."""

    number: int
    """Counts the changes of a run, from 1"""
    config: list[str]
    """The configuration with the change, as JSON, in parts"""
    law: Law | None
    """New law, positioned without the start position; None: the same law with other gains"""
    watch: WatchSettings
    moved: bool
    """Whether law or position differ"""
    softer: bool
    """Whether the change is only a lower stiffness"""
    decisions: list[Decision]
    """The different decisions"""
    bins: list[list[int]]
    """The index of each bin's decision, as ``GainSchedule`` takes the decisions"""
    injected: list[float]
    """``most_injected`` of the bins"""
    steps: int
    """Steps of the inserted delay [periods]"""
    highest: float = 0.0
    """Largest stiffness of the decisions [N·m/rad]"""
    rows: Sequence[Sequence[Decision]] = ()
    """The decisions of the bins; computed by ``complete``"""
    placed: bool = False
    """Whether the start position was added to the law's position, where ``wall.reference`` says
    so"""
    another: bool = False
    """Whether it is another law, not the same one with other gains or at another position"""

    def complete(self) -> None:
        """Compute the fields that are not sent to the loop's process."""
        decisions = self.decisions
        self.rows = [[decisions[index] for index in row] for row in self.bins]
