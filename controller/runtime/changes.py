"""Computes a change of a running wall, outside of the loop: validated, decided, tabulated."""

from __future__ import annotations

from haptic_wall.controller.guard.bins import Bins
from haptic_wall.controller.runtime.assembly import bins_of, gain_table, law_of, watch_settings
from haptic_wall.controller.runtime.handover import Change, KnownServo
from haptic_wall.controller.settings.changes import moved
from haptic_wall.controller.settings.config import Config


def change_of(
    number: int, old: Config, new: Config, servo: KnownServo, axis: int = 0
) -> tuple[Change, Bins]:
    """Return a change, and the bins that the guard has decided for; takes milliseconds to seconds.

    Args:
        number: Counts the changes of a run, from 1.
        old: The configuration of the axis in force.
        new: That with the change.
        servo: Of the axis.
        axis: Its index.

    Raises:
        ExplainedError: See ``law_of``.
    """
    bins = bins_of(new, servo)
    law, elsewhere = law_of(new, servo.facts), moved(old, new)
    change = Change(
        number=number,
        config=new.model_dump_json(),
        law=law if elsewhere or not law.linear else None,
        watch=watch_settings(new, servo.facts, law),
        moved=elsewhere,
        softer=not elsewhere
        and old.wall.damping == new.wall.damping
        and old.delay.steps == new.delay.steps
        and old.wall.stiffness >= new.wall.stiffness,
        table=gain_table(new, bins),
        steps=new.delay.steps,
        axis=axis,
    )
    return change, bins
