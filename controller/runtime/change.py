"""Describes a change of a running wall for the loop: law, decisions, delay."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from haptic_wall.controller.detector.settings import WatchSettings
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
class SentDecision:
    """The numbers of a decision that a tick needs; the others stay in bytes until somebody asks.

    It takes the place of a ``Decision`` in the gain schedule: to make a whole one takes longer.
    """

    stiffness: float
    """[N·m/rad]"""
    damping: float
    """[N·m·s/rad]"""
    delay: float
    """[s]"""
    damping_ceiling: float
    """[N·m·s/rad]"""
    whole: bytes

    @classmethod
    def of(cls, decision: Decision) -> Self:
        """Return the decision as it is sent."""
        return cls(
            decision.stiffness,
            decision.damping,
            decision.delay,
            decision.damping_ceiling,
            pickle.dumps(decision, pickle.HIGHEST_PROTOCOL),
        )

    @property
    def fields(self) -> tuple[float, float, float, float, bytes]:
        """Return its fields, in their order."""
        return self.stiffness, self.damping, self.delay, self.damping_ceiling, self.whole


def whole_decision(decision: Decision | SentDecision) -> Decision:
    """Return a decision of the gain schedule with all of its fields."""
    if not isinstance(decision, SentDecision):
        return decision
    whole = pickle.loads(decision.whole)
    assert isinstance(whole, Decision)
    return whole


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
    """The different decisions; where they were sent, each is a ``SentDecision``"""
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

    def complete(self) -> None:
        """Compute the fields that are not sent to the loop's process."""
        decisions = self.decisions
        self.rows = [[decisions[index] for index in row] for row in self.bins]
