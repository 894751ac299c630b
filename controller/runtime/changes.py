"""Computes changes of a running wall, outside of the loop: validated, decided, tabulated."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_wall.controller.runtime.assembly import (
    Decided,
    guard_decisions,
    law_of,
    watch_settings,
)
from haptic_wall.controller.runtime.handover import Change, KnownServo
from haptic_wall.controller.settings.changes import moved
from haptic_wall.controller.settings.config import Config


@dataclass(slots=True)
class Changes:
    """Computes the changes of a run, one after the other.

    Attributes:
        configs: Configuration of each axis in force now.
        servos: Of each axis; empty until they are known.
        decided: The decisions for the configuration that was computed last.
    """

    configs: list[Config]
    servos: list[KnownServo]
    number: int = 0
    decided: Decided | None = None

    def computed(self, new: Config, axis: int = 0) -> Change:
        """Return the change to ``new``; takes milliseconds to seconds.

        Args:
            new: The configuration of the axis with the change.
            axis: Its index.

        Raises:
            ExplainedError: See ``law_of``.
        """
        old, servo = self.configs[axis], self.servos[axis]
        self.number += 1
        self.decided = guard_decisions(new, servo)
        law = law_of(new, servo.facts)
        elsewhere = moved(old, new)
        return Change(
            number=self.number,
            config=new.model_dump_json(),
            law=law if elsewhere or not law.linear else None,
            watch=watch_settings(new, servo.facts, law),
            moved=elsewhere,
            softer=not elsewhere
            and old.wall.damping == new.wall.damping
            and old.delay.steps == new.delay.steps
            and old.wall.stiffness >= new.wall.stiffness,
            table=self.decided.table,
            steps=new.delay.steps,
            axis=axis,
        )
