"""The detector: judges from the believed values whether the loop oscillates by itself.

It answers three questions, in the order in which they can be answered. Has the wall given more
energy since the last turning point than friction can dissipate? Does the acting torque alone
explain the motion, half-cycle after half-cycle, while it grows? And if it does not grow: is it more
regular than any hand?
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import IntEnum

from haptic_wall.controller.detector.energy import EnergyBalance
from haptic_wall.controller.detector.half_cycle_sums import HalfCycle, HalfCycleSums
from haptic_wall.controller.detector.regularity import bounces_grow, goes_on, grows_evenly, line
from haptic_wall.controller.detector.streaks import Streaks
from haptic_wall.controller.detector.tuning import TUNING, Tuning


class State(IntEnum):
    """State of the loop's own oscillation; the worse, the greater. A hand's motion is quiet."""

    QUIET = 0
    DECAYING = 1
    SUSTAINED = 2
    GROWING = 3


@dataclass(frozen=True, slots=True)
class DetectorSettings:
    """The detector's knowledge of the servo; NaN: not known.

    Without the inertia it uses the motion alone.
    """

    period: float
    """T [s]"""
    inertia: float = math.nan
    """m [kg·m²]"""
    damping: float = math.nan
    """Viscous friction b [N·m·s/rad]"""
    coulomb: float = math.nan
    """Coulomb friction c [N·m]"""
    position_step: float = math.nan
    """Encoder count q [rad]; 0: not quantised"""
    torque_limit: float = math.inf
    """[N·m]"""
    tuning: Tuning = TUNING
    torque_step: float = 0.0
    """Torques are rounded to multiples of it [N·m]; 0: not rounded"""


class Detector:
    """Judges position and acting torque, sample by sample.

    Attributes:
        state: State of the motion now.
        frequency_hz: Frequency of the oscillation [Hz]; NaN while there is none.
        amplitude: Half its width [rad]; 0 while there is none.
        alarm: It is sustained or grows, and the wall feeds it.
        balance: The energy balance; its ``surface``, ``side`` and ``lag`` may be set at any time.
    """

    def __init__(self, settings: DetectorSettings) -> None:
        self.settings = settings
        step = settings.position_step
        self._step = step if step > 0.0 else 0.0
        tuning = settings.tuning
        self._tuning, self._still = tuning.belief, tuning.half_cycles.still
        self._rounding = self._step
        self.balance = EnergyBalance(
            settings.period,
            settings.inertia,
            settings.damping,
            settings.coulomb,
            settings.position_step,
            settings.torque_limit,
            tuning.energy,
            settings.torque_step,
        )
        self._motion: HalfCycleSums | None = None
        self._before: HalfCycle | None = None
        self._mixed = self._blind = self._fresh = False
        self._changed_at = -math.inf  # time of the motion [s]
        self._streaks = Streaks(tuning.streaks)
        self._sizes: deque[float] = deque(maxlen=tuning.belief.sustained)
        self._times: deque[float] = deque(maxlen=tuning.belief.sustained)
        self._quiet()

    @property
    def stiffness(self) -> float:
        """Commanded K [N·m/rad]; NaN: not known. May be changed at any time."""
        return self.balance.stiffness

    @stiffness.setter
    def stiffness(self, value: float) -> None:
        known = self.balance.stiffness
        if value == known or (math.isnan(value) and math.isnan(known)):
            return
        self.balance.stiffness = value
        # A torque that is rounded to u moves as a spring does whose elongation is rounded to u/K.
        of_torque = self.settings.torque_step / value if value > 0.0 else 0.0
        self._rounding = max(self._step, of_torque)
        self._mixed = True  # the spring's energy is not what it was at the turning point
        if self._motion is not None:
            self._changed_at = self._motion.time
        self._refilter()

    def _refilter(self) -> None:
        natural, tuning = self.balance.natural, self._tuning
        if self._motion is not None and natural > 0.0:
            self._motion.filter(min(tuning.filter / natural, tuning.filter_s))

    @property
    def _least(self) -> float:
        """Return the logarithm of the amplitude from which growth is told from rounding."""
        least = self._tuning.least_counts * self._rounding
        return math.log(least) if least > 0.0 else -math.inf

    @property
    def energy(self) -> tuple[float, float]:
        """Return the torque's work [J] and the integrated squared velocity [rad²/s]."""
        motion = self._motion
        return (0.0, 0.0) if motion is None else (motion.work, motion.square)

    def restart(self) -> None:
        """Discard all observations."""
        self._motion = None
        self._changed_at = -math.inf
        self._quiet()

    def _quiet(self) -> None:
        self.state = State.QUIET
        self.alarm = False
        self.frequency_hz = math.nan
        self.amplitude = 0.0
        self._patience = math.inf
        self._gives = True  # whether nothing speaks against it that the wall gives out energy
        self._way = self._tuning.first_counts * self._rounding
        self._streaks.clear()
        self._before = None
        self._sizes.clear()
        self._times.clear()

    def update(self, position: float, torque: float, periods: int = 1) -> State:
        """Take a sample.

        Args:
            position: Measured [rad].
            torque: Mean torque that acted since the last sample [N·m]; NaN: not known, and its
                relation to the motion is not judged.
            periods: Number of periods from the last sample to this one, >= 1.
        """
        motion = self._motion
        if math.isnan(torque):
            torque, self._blind = 0.0, True
        if motion is None:
            turning = self.settings.tuning.half_cycles
            self._motion = HalfCycleSums(self.settings.period, self._step, position, turning)
            self._refilter()
            self._fresh = True
            return self.state
        if motion.update(position, torque, periods):
            earlier = motion.before
            half_cycle = motion.half_cycle()
            if half_cycle is not None:
                self._take(half_cycle)
                if self._gives and self.balance.side and not (self.alarm or self._torn):
                    way = half_cycle.path + abs(half_cycle.start - earlier[0])
                    if way > 2.0 * self._way:
                        self._check(self.balance.gives_out(motion.since, earlier, way, 0.0))
            # The last turning point may lie before a change that the torque follows later.
            self._mixed = self._changed_at + self.balance.lag + motion.smear > motion.since[1]
            self._blind = False
        elif motion.time > self._patience:
            self._quiet()
        elif self._gives and not (self.alarm or self.balance.side or self._torn):
            since = motion.since
            way = abs(motion.position - since[0])
            if way > self._way:
                self._mixed = self._fresh and self._came_in(motion)
                self._fresh = False
                if not self._mixed:
                    self._check(self.balance.gives_out(motion.now(), since, way, motion.speed))
        return self.state

    def _came_in(self, motion: HalfCycleSums) -> bool:
        """Whether the first motion goes into the wall: it came with a speed, or a hand moves it.

        The wall's torque then began during the motion, later than its potential by the delay and
        the filter, and seems to take less than the spring stores.
        """
        potential = self.balance.potential
        return potential(motion.position) > potential(motion.since[0])

    @property
    def _torn(self) -> bool:
        """Whether the present half-cycle's energy is unknown."""
        return self._mixed or self._blind

    def _check(self, gives_out: bool) -> None:
        if gives_out:
            self.alarm = True
            self.state = State.GROWING
            if math.isnan(self.frequency_hz):
                self.frequency_hz = self.balance.natural / (2.0 * math.pi)

    def _take(self, half_cycle: HalfCycle) -> None:
        """Process a half-cycle."""
        self._patience = half_cycle.ended + self._still * half_cycle.duration
        balance, blind, streaks = self.balance, self._blind, self._streaks
        if not blind:
            balance.judge(half_cycle, self._before)
        self._before = None if blind else half_cycle
        fine = self._step / half_cycle.amplitude
        size = math.log(half_cycle.amplitude)
        sizes, times = self._sizes, self._times
        change = size - sizes[-1] if sizes else 0.0
        sizes.append(size)
        times.append(half_cycle.ended)
        alike = abs(change) <= self._tuning.symmetric
        moved = blind or (balance.moves and not self._mixed)
        streaks.take(
            moved=moved and alike,
            explained=alike and (blind or (moved and balance.pays)),
            share=1.0 if blind else balance.share,
            left=0.0 if blind else balance.left,
            fine=fine,
        )
        streaks.went_outward(self._outward(half_cycle) if streaks.explained else 0.0)
        self._way = self._tuning.later_counts * self._rounding
        if balance.side:
            self._gives = streaks.moved > 1
        else:
            self._gives = self._mixed or (balance.gave(half_cycle) and (moved or len(sizes) == 1))
        known = len(sizes)
        self.amplitude = half_cycle.amplitude
        back = min(known - 1, 4)
        self.frequency_hz = 0.5 / half_cycle.duration
        if back:
            passed = half_cycle.ended - times[-1 - back]
            self.frequency_hz = 0.5 * back / passed
        if self.alarm:
            self._alarmed(fine)
        elif self._regular(fine) or (not (blind or balance.side) and self._grown()):
            self.alarm = half_cycle.amplitude >= self._tuning.alarm_counts * self._rounding
            self.state = State.SUSTAINED
            if self.alarm:
                self._alarmed(fine)
        elif streaks.explained >= 2 and change < -self._tuning.steady:
            self.state = State.DECAYING
        elif not streaks.explained:
            self.state = State.QUIET

    def _outward(self, half_cycle: HalfCycle) -> float:
        """Return the growth of the distance from a two-sided wall, as a logarithm."""
        surface = self.balance.surface
        start, end = half_cycle.start - surface, half_cycle.end - surface
        least = self._tuning.least_counts * self._rounding
        if start * end < 0.0 and abs(start) > least and abs(end) > least:
            return math.log(abs(end / start))
        return 0.0

    def _grown(self) -> bool:
        streaks, tuning = self._streaks, self._tuning
        if (
            streaks.outward >= tuning.outward_half_cycles
            and streaks.grown > tuning.outward
            and streaks.least_outward > tuning.outward_each
        ):
            return True
        sizes = self._sizes
        for count, growth in tuning.grown:
            if streaks.explained < count:
                return False
            known = min(count + 1, len(sizes))
            first = sizes[-known]
            grown = sizes[-1] - first
            # A motion that grows by itself continues to grow; a hand's motion stops growing.
            last = sizes[-1] - sizes[-2]
            if first > self._least and grown > growth and last > tuning.grows_on * grown / count:
                straight = tuning.straight + tuning.scatter_counts * self._step * math.exp(-first)
                if line(sizes, known).scatter < straight:
                    return True
        return False

    def _regular(self, fine: float) -> bool:
        """Whether it grows slowly, or persists, more regularly than a hand can."""
        sizes, least, streaks = self._sizes, self._least, self._streaks
        tuning = self._tuning
        allowed = tuning.regular + tuning.scatter_counts * fine
        if self.balance.side and sizes[-1] > least and bounces_grow(sizes, streaks.moved, tuning):
            return True
        if grows_evenly(sizes, tuning.grown_evenly, streaks.explained, least, allowed):
            return True
        if not (self._blind or self.balance.side or math.isnan(self.settings.inertia)):
            least += math.log(tuning.unpaid_counts / tuning.least_counts)
            even = tuning.regular + tuning.unpaid_scatter_counts * fine
            streak = min(streaks.moved, streaks.even)
            if grows_evenly(sizes, tuning.grown_unpaid, streak, least, even):
                return True
        return streaks.explained >= tuning.sustained and goes_on(sizes, allowed, tuning)

    def _alarmed(self, fine: float) -> None:
        sizes = self._sizes
        back = min(len(sizes) - 1, 2)
        change = (sizes[-1] - sizes[-1 - back]) / back if back else 0.0
        if change < -self._tuning.shrinks - fine:
            self.alarm = False
            self.state = State.DECAYING
            self._streaks.clear()
        else:
            grows = change > self._tuning.steady + fine
            self.state = State.GROWING if grows else State.SUSTAINED
