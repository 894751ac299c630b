"""Feeds the rows of a log to an oscillation watch, tick by tick, as in the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.detection import DetectionRecord, Known, growths
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.laws.wall import Law
from haptic_wall.controller.logs.recording import Part
from haptic_wall.controller.runtime.changeover import adopt
from haptic_wall.controller.runtime.telemetry import (
    FLAG_CHANGED,
    FLAG_OFF,
    FLAG_RAISED,
    FLAG_WARM_UP,
)
from haptic_wall.hw.servo import Outcome

_FIELDS = (
    "seq",
    "deadline_ns",
    "sampled_ns",
    "outcome",
    "flags",
    "position",
    "torque",
    "stiffness",
    "damping",
    "delay_s",
    "measured_torque",
    "held_torque",
)


@dataclass(frozen=True, slots=True)
class LaterWall:
    """A change of the running wall."""

    law: Law
    settings: WatchSettings
    before_age_s: float | None
    """As of ``Replay``"""


class Replay:
    """Feeds an oscillation watch with the inputs that it had in the run, from blocks of rows.

    Each sample is combined with the stiffness, damping and delay of the row before, because a row
    holds the values at the end of its tick.

    Args:
        watch: The oscillation watch, in its initial state.
        law: The run's law; the replay sets its stiffness and damping.
        period_ns: T [ns]
        before_age_s: The part of the rows' delay that is not sample age [s]; None: the watch
            already has its lag.
        later: The changes of the wall by their rows' sequence numbers.

    Attributes:
        unknown: Number of changes in the rows that are not in ``later``.
    """

    def __init__(
        self,
        watch: Watch,
        law: Law,
        period_ns: int,
        before_age_s: float | None,
        later: Mapping[int, LaterWall],
    ) -> None:
        self.watch = watch
        self._law = law
        law.derating = watch.backstop.derating
        self._period_ns = period_ns
        self._before_age_s = before_age_s
        self._later = later
        self.unknown = 0
        self._last: tuple[int, int] | None = None  # seq and deadline of the last row
        self._left = (0.0, 0.0, 0.0)  # stiffness, damping, delay
        self._on = self._came_on = False
        self._delay_s = -1.0

    @property
    def counts_ages(self) -> bool:
        """Whether the replay adds the sample age of the rows to the watch's lag."""
        return self._before_age_s is not None

    def see(self, rows: NDArray[np.void], part: Part, known: Known) -> DetectionRecord:
        """Feed the next rows to the watch; return the detection record of each row.

        Args:
            rows: Shape (n,), n > 0, dtype ``telemetry.ROW``.
            part: The motion in these rows.
            known: Values of the servo, for the growth.
        """
        n = len(rows)
        state, alarm = np.zeros(n, dtype=np.int8), np.zeros(n, dtype=np.bool_)
        frequency, amplitude = np.full(n, np.nan), np.zeros(n)
        watch = self.watch
        for k, row in enumerate(zip(*(rows[name].tolist() for name in _FIELDS), strict=True)):
            self._take(*row)
            if watch.current:
                state[k], alarm[k] = watch.current, watch.alarm
                frequency[k], amplitude[k] = watch.seen
        growth = growths(part.times, part.positions, part.torques, known)
        growth[state == 0] = np.nan
        return DetectionRecord.of(part.times, state, frequency, amplitude, growth, alarm)

    def _take(
        self,
        seq: int,
        deadline_ns: int,
        sampled_ns: int,
        outcome: int,
        flags: int,
        position: float,
        torque: float,
        stiffness: float,
        damping: float,
        delay_s: float,
        measured: float,
        held: float,
    ) -> None:
        watch, law = self.watch, self._law
        periods = 1
        if self._last is None:
            self._left = stiffness, damping, delay_s
        else:
            periods = max(1, round((deadline_ns - self._last[1]) / self._period_ns))
            if seq != self._last[0] + 1:
                watch.resume()  # rows are missing: the motion in between is unknown
                self._left = stiffness, damping, delay_s
        on = not flags & (FLAG_WARM_UP | FLAG_OFF)
        if on and not self._on and self._came_on:
            watch.resume()
        if flags & FLAG_CHANGED:
            self._left = stiffness, damping, delay_s
            self._change(seq)
        self._on = on
        self._came_on = self._came_on or on
        if on and sampled_ns:
            self._sample(position, outcome, measured, periods)
        watch.sent(torque)
        if flags & FLAG_RAISED:
            watch.raise_again()
        law.held = held
        self._last = seq, deadline_ns
        self._left = stiffness, damping, delay_s

    def _change(self, seq: int) -> None:
        """Render and watch as the change of this row asks for."""
        later = self._later.get(seq)
        if later is None:
            self.unknown += 1
            return
        adopt(later.law, self._law)
        way = later.law.position - self._law.position
        self._law, self._before_age_s, settings = later.law, later.before_age_s, later.settings
        self.watch.change(settings, way)

    def _sample(self, position: float, outcome: int, measured: float, periods: int) -> None:
        watch, law = self.watch, self._law
        stiffness, damping, delay_s = self._left
        if self._before_age_s is not None and delay_s != self._delay_s:
            self._delay_s = delay_s
            watch.set_age(max(0, round((delay_s - self._before_age_s) * 1e9)) * 1e-9)
        watch.passed(periods)
        if outcome != Outcome.OK:
            return
        law.stiffness = stiffness / law.derating.scale
        law.damping = damping / law.derating.damping_scale
        watch.sample(position, law, measured)
