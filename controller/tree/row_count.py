"""What the supervisor makes of the rows as they pass: statistics, and word of an oscillation."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

from controller.detector.oscillation import State
from controller.statistics import RunStatistics
from controller.telemetry import Telemetry
from controller.tree.plan import Plan, Tell


class RowCount:
    """Counts rows in batches.

    Args:
        telemetry: Where they come from.
        plan: Of the run.
        tell: Called once when an oscillation is noticed, and once when it is over.

    Attributes:
        statistics: Of the rows until now.
    """

    def __init__(self, telemetry: Telemetry, plan: Plan, tell: Tell) -> None:
        self._telemetry = telemetry
        self._tell = tell
        self._reduces = plan.config.safety.on_oscillation == "reduce"
        self._silent = bool(plan.program)  # an experiment makes its own of it
        self._tail = 0
        self._oscillates = False
        self.statistics = RunStatistics()

    def count(self) -> None:
        """Take in the rows that have come since the last call."""
        rows, self._tail = self._telemetry.read(self._tail)
        self.statistics.add(rows)
        if rows.size and not self._silent:
            self._tell_of_oscillation(rows)

    def _tell_of_oscillation(self, rows: NDArray[np.void]) -> None:
        oscillates = bool(np.any(rows["oscillation"] >= State.SUSTAINED))
        if oscillates and not self._oscillates:
            softer = (
                f"; the wall is made softer until it decays, kill -USR1 {os.getpid()} asks for the"
                " full wall again"
                if self._reduces
                else ""
            )
            self._tell(f"the wall oscillates by itself{softer}")
        elif self._oscillates and not oscillates:
            stiffness = float(rows["stiffness"][-1])
            self._tell(f"the oscillation is over; the stiffness is {stiffness:.4g} N·m/rad")
        self._oscillates = oscillates
