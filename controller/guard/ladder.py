"""Which of the guard's decisions holds now: a ladder of delays, climbed by measured sample ages.

The guard's mathematics takes milliseconds to seconds, a tick has microseconds. So the decisions
are computed before the start for a ladder of sample ages, and the tick only picks the rung.

The rule: over a window, the percentile of the ages picks the rung. A run of ages above the rung
lowers at once, without waiting for the window; a single hiccup does neither. Going back to a
stiffer rung takes ``RAISE_WINDOWS`` whole windows that allow it, and a moment out of contact or so
near the surface that ΔK x is a small torque: raising K at a penetration x puts the energy ΔK x²/2
into the spring.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from controller.guard.guard import Decision

RUN = 10
"""The least number of ages in a row above the rung that lower at once."""
RUN_S = 0.05
"""How long such a run is at high rates [s]: shorter ones are hiccups, in which not even a wall at
twice its limit gets going (its oscillation grows by some per cent)."""
SETTLE = 50
"""Ages that are enough to begin with."""
RAISE_WINDOWS = 5
"""Windows in a row that must allow a stiffer rung before it is taken."""


def rung_ages_ns(period_ns: int, reply_ns: int = 0) -> list[int]:
    """Sample ages of the rungs [ns]: fine where buses are quick, coarse where they are slow.

    They reach to 20 ms and three periods, so that at low rates too a pipelined sample, a period
    old, and the loss of the one after it are not counted as younger than they are. Where replies
    take several periods it is three of their times.

    Args:
        period_ns: The sampling period [ns].
        reply_ns: How long replies take, where that is several periods [ns].
    """
    microseconds = [*range(0, 600, 10), *range(600, 2000, 100), *range(2000, 20_001, 1000)]
    microseconds += range(22_000, 3 * max(period_ns, reply_ns) // 1000 + 2000, 2000)
    return [us * 1000 for us in microseconds]


class GuardLadder:
    """Picks the decision for the ages it is shown.

    Args:
        decisions: One for each age, by rising age.
        ages_ns: The ages the decisions were made for [ns], rising.
        percentile: Which percentile of the window's ages must be covered [%].
        window: Ages in a window.
        run: Ages in a row above the rung that lower at once.
    """

    def __init__(
        self,
        decisions: Sequence[Decision],
        ages_ns: Sequence[int],
        percentile: float,
        window: int,
        run: int = RUN,
    ) -> None:
        self._decisions = decisions
        self._ages = ages_ns
        self._top = len(ages_ns) - 1
        self._percent_above = 100.0 - percentile
        self._window = window
        self._counts = [0] * len(ages_ns)
        self._seen = 0
        self._run = 0
        self._run_length = run
        self._run_rung = 0
        self._raise_windows = 0
        self._raise_rung = 0
        self.rung = 0

    def anew(self) -> GuardLadder:
        """One for the same ages that has seen none."""
        percentile = 100.0 - self._percent_above
        return GuardLadder(self._decisions, self._ages, percentile, self._window, self._run_length)

    @property
    def decisions(self) -> Sequence[Decision]:
        """All of them, one for each age."""
        return self._decisions

    @property
    def decision(self) -> Decision:
        """The decision that holds."""
        return self._decisions[self.rung]

    @property
    def age_ns(self) -> int:
        """The sample age that decision counts with [ns]."""
        return self._ages[self.rung]

    def observe(self, age_ns: int, may_raise: bool) -> bool:
        """Count one age [ns]; whether another decision holds from now on.

        Args:
            age_ns: Age of the sample when its torque was sent.
            may_raise: The wall's spring is at rest, so the stiffness may go up.
        """
        before = self.rung
        rung = min(bisect_left(self._ages, age_ns), self._top)
        self._counts[rung] += 1
        self._seen += 1
        if rung > before:
            self._run += 1
            self._run_rung = rung if self._run == 1 else min(rung, self._run_rung)
            if self._run >= self._run_length:
                self._lower(self._run_rung)
        else:
            self._run = 0
        if self._seen >= self._window:
            self._end_window()
        if may_raise and self._raise_windows >= RAISE_WINDOWS and self._raise_rung < self.rung:
            self.rung = self._raise_rung
            self._raise_windows = 0
        return self.rung != before

    def settle(self) -> None:
        """End the warm-up: take the rung its ages ask for, stiffer or softer, and start afresh.

        Fewer than ``SETTLE`` ages since the last window ended are no reason for a stiffer one.
        """
        if self._seen:
            rung = self._percentile_rung()
            self.rung = rung if self._seen >= SETTLE else max(rung, self.rung)
        self._restart_window()
        self._run = self._raise_windows = 0

    def _lower(self, rung: int) -> None:
        """Take a softer rung; what was counted toward leaving the one before is void."""
        self.rung = rung
        self._run = self._raise_windows = 0

    def _percentile_rung(self) -> int:
        allowed = self._seen * self._percent_above / 100.0
        above = 0
        for rung in range(self._top, -1, -1):
            above += self._counts[rung]
            if above > allowed:
                return rung
        return 0

    def _restart_window(self) -> None:
        self._counts = [0] * (self._top + 1)
        self._seen = 0

    def _end_window(self) -> None:
        rung = self._percentile_rung()
        self._restart_window()
        if rung >= self.rung:
            if rung > self.rung:
                self._lower(rung)
            self._raise_windows = 0
            return
        self._raise_rung = rung if self._raise_windows == 0 else max(rung, self._raise_rung)
        self._raise_windows += 1
