"""Computes changes of a running wall, outside of the loop: validated, decided, tabulated."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from haptic_wall.controller.guard.guard import Decision
from haptic_wall.controller.guard.schedule import GainSchedule
from haptic_wall.controller.runtime.assembly import guard_schedule, most_injected
from haptic_wall.controller.runtime.change import Change, KnownServo
from haptic_wall.controller.runtime.watch_settings import watch_settings
from haptic_wall.controller.settings.changes import moved_by
from haptic_wall.controller.settings.config import Config

_PART: Final = 4096
"""Characters of the configuration in a part"""
_KEPT: Final = 16
"""Number of requests whose decisions are kept"""


@dataclass(slots=True)
class Changes:
    """Computes the changes of a run, one after the other.

    Attributes:
        config: Configuration in force now.
        schedule: The decisions for the configuration that was computed last.
    """

    config: Config
    servo: KnownServo
    number: int = 0
    schedule: GainSchedule | None = None
    _known: dict[str, tuple[GainSchedule, list[float]]] = field(default_factory=dict)

    def computed(self, new: Config) -> Change:
        """Return the change to ``new``; takes milliseconds to seconds.

        Raises:
            ConfigError: The encoder does not resolve the law.
        """
        old, servo = self.config, self.servo
        self.number += 1
        self.schedule, injected = self._decided(new)
        found: dict[int, int] = {}
        decisions: list[Decision] = []
        for decision in self.schedule.decisions:
            if id(decision) not in found:
                found[id(decision)] = len(decisions)
                decisions.append(decision)
        law = new.law(servo.facts.position_step)
        text = new.model_dump_json()
        way = moved_by(old, new)
        elsewhere = way != 0.0
        return Change(
            number=self.number,
            config=[text[at : at + _PART] for at in range(0, len(text), _PART)],
            law=law if elsewhere or not law.linear else None,
            watch=watch_settings(new, servo.facts, law),
            moved=elsewhere,
            softer=not elsewhere
            and old.wall.damping == new.wall.damping
            and old.delay.steps == new.delay.steps
            and old.wall.stiffness >= new.wall.stiffness,
            decisions=decisions,
            bins=[[found[id(each)] for each in row] for row in self.schedule.rows],
            injected=injected,
            steps=new.delay.steps,
            highest=max(decision.stiffness for decision in decisions),
        )

    def _decided(self, new: Config) -> tuple[GainSchedule, list[float]]:
        """Return the guard's decisions; those of the last few requests are kept."""
        request = new.request(self.servo.facts.position_step)
        asked = repr((request, new.delay.steps))
        if asked not in self._known:
            schedule = guard_schedule(new, self.servo, self.servo.simulated)
            if len(self._known) >= _KEPT:
                self._known.pop(next(iter(self._known)))
            self._known[asked] = schedule, most_injected(new, self.servo, schedule)
        return self._known[asked]
