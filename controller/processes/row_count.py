"""Computes statistics of a run's rows; reports oscillations and a dead man's wall to a person."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.state import State
from haptic_wall.controller.laws.engagement import place_text
from haptic_wall.controller.processes.plan import Plan, Tell
from haptic_wall.controller.runtime.statistics import RunStatistics
from haptic_wall.controller.runtime.telemetry import FLAG_OFF, FLAG_WARM_UP, Telemetry, Word

BATCH = 5000
"""Number of rows that are counted together. Counting is the supervisor's longest work, hardly
longer for many rows than for few; meanwhile the kernel threads that carry the loop's bytes wait for
their core."""


class RowCount:
    """Reads rows from the telemetry during the run, and counts them in batches.

    Args:
        telemetry: Source of the rows.
        plan: Plan of the run.
        tell: Called once when an oscillation is noticed, and once when it is over; and when a wall
            with a dead man goes off or comes back.

    Attributes:
        statistics: Statistics of the rows so far.
    """

    def __init__(self, telemetry: Telemetry, plan: Plan, tell: Tell) -> None:
        self._telemetry = telemetry
        self._tell = tell
        self._axes = plan.axes
        self._reduces = plan.config.safety.on_oscillation == "reduce"
        self._silent = bool(plan.program)  # an experiment judges oscillations itself
        self._looked_at = 0
        self._oscillates = False
        self._held = plan.hold is not None
        self._told = ""
        self.statistics = RunStatistics(telemetry.axes)

    def look(self) -> None:
        """Report changes of the oscillation's state; count if a batch is complete."""
        rows, self._looked_at = self._telemetry.read(self._looked_at)
        if rows.size and not self._silent:
            self._tell_of_oscillation(rows)
        if rows.size and self._held:
            self._tell_of_hold(max(rows[-1], key=lambda row: row["flags"] & FLAG_OFF))
        if self._looked_at - self.statistics.next_seq >= BATCH:
            self._count()

    def end(self) -> None:
        """Count the last rows: no more will come."""
        self.look()
        self._count()

    def _count(self) -> None:
        self.statistics.add(self._telemetry.read(self.statistics.next_seq)[0])

    def _tell_of_oscillation(self, rows: NDArray[np.void]) -> None:
        seen = rows["oscillation"].max(axis=0) >= State.SUSTAINED
        oscillates = bool(np.any(seen))
        if oscillates and not self._oscillates:
            softer = (
                f"; stiffness and damping are reduced until it decays, `kill -USR1 {os.getpid()}`"
                " requests the full wall again"
                if self._reduces
                else ""
            )
            names = ", ".join(
                name for name, sees in zip(self._axes, seen.tolist(), strict=True) if sees
            )
            of = f" of {names}" if names else ""
            self._tell(f"the wall{of} oscillates by itself{softer}")
        elif self._oscillates and not oscillates:
            stiffness = ", ".join(f"{each:.4g}" for each in rows["stiffness"][-1])
            self._tell(f"the oscillation is over; the stiffness is {stiffness} N·m/rad")
        self._oscillates = oscillates

    def _tell_of_hold(self, row: np.void) -> None:
        """Report changes of a wall that has been on; the session reports those before."""
        if row["flags"] & FLAG_WARM_UP:
            return
        if not row["flags"] & FLAG_OFF:
            news, text = "on", "the wall is on again" if self._told else ""
        elif self._telemetry.words[Word.HELD_NS] < row["deadline_ns"]:
            news, text = "released", "released; the wall is off"
        else:
            where = place_text(float(row["position"]))
            news = "waits"
            text = f"held, but the wall waits: at {where} it would push the shaft with a blow"
        if text and news != self._told:
            self._tell(f"--hold: {text}")
        if text or self._told:
            self._told = news
