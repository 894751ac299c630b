"""The watch of a run once more over the rows of its log: what it saw, tick by tick."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.detection import DetectionRecord
from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.laws.wall import Law
from haptic_wall.controller.runtime.telemetry import FLAG_OFF, FLAG_RAISED, FLAG_WARM_UP
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
)


class Replay:
    """Feeds a watch what it was fed in the run; rows may come in any number of blocks.

    A sample met the stiffness, the damping and the delay of the row before: a row holds what its
    tick left behind.

    Args:
        watch: As it was when the run began.
        law: Stands where the wall stood; its stiffness and damping are set here.
        period_ns: T [ns]
        before_age_s: What the rows' delay holds beside the age of a sample [s]; None: the watch
            knows its lag already.
    """

    def __init__(self, watch: Watch, law: Law, period_ns: int, before_age_s: float | None) -> None:
        self.watch = watch
        self._law = law
        self._period_ns = period_ns
        self._before_age_s = before_age_s
        self._last: tuple[int, int] | None = None  # seq and deadline of the row before
        self._left = (0.0, 0.0, 0.0)  # stiffness, damping, delay
        self._on = self._came_on = False
        self._delay_s = -1.0

    @property
    def counts_ages(self) -> bool:
        """Whether the age of the samples is part of the lag."""
        return self._before_age_s is not None

    def see(self, rows: NDArray[np.void], times: NDArray[np.float64]) -> DetectionRecord:
        """Take the next rows, those of the warm-up left out.

        Args:
            rows: Shape (n,), n > 0, dtype ``telemetry.ROW``.
            times: Of the rows [s].
        """
        n = len(rows)
        state, alarm = np.zeros(n, dtype=np.int8), np.zeros(n, dtype=np.bool_)
        frequency, growth, amplitude = np.full(n, np.nan), np.full(n, np.nan), np.zeros(n)
        watch = self.watch
        for k, row in enumerate(zip(*(rows[name].tolist() for name in _FIELDS), strict=True)):
            self._take(*row)
            if watch.current or (k and alarm[k - 1]):
                state[k] = watch.current
                frequency[k], amplitude[k], growth[k], alarm[k] = watch.seen
        return DetectionRecord.of(times, state, frequency, amplitude, growth, alarm)

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
    ) -> None:
        watch, law = self.watch, self._law
        periods = 1
        if self._last is None:
            self._left = stiffness, damping, delay_s
        else:
            periods = max(1, round((deadline_ns - self._last[1]) / self._period_ns))
            if seq != self._last[0] + 1:
                watch.resume()  # rows are lost: nobody knows what moved meanwhile
                self._left = stiffness, damping, delay_s
        on = not flags & (FLAG_WARM_UP | FLAG_OFF)
        if on and not self._on and self._came_on:
            watch.resume()
        self._on = on
        self._came_on = self._came_on or on
        if on and sampled_ns:
            self._sample(position, outcome, measured, periods)
        watch.sent(torque)
        if flags & FLAG_RAISED:
            watch.raise_again()
        law.scale, law.damping_scale = watch.scale, watch.damping_scale
        self._last = seq, deadline_ns
        self._left = stiffness, damping, delay_s

    def _sample(self, position: float, outcome: int, measured: float, periods: int) -> None:
        watch, law = self.watch, self._law
        stiffness, damping, delay_s = self._left
        if self._before_age_s is not None and delay_s != self._delay_s:
            self._delay_s = delay_s
            watch.set_age(max(0, round((delay_s - self._before_age_s) * 1e9)) * 1e-9)
        watch.passed(periods)
        if outcome != Outcome.OK:
            return
        law.stiffness = stiffness / law.scale
        law.damping = damping / law.damping_scale
        watch.sample(position, law, measured)
