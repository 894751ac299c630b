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

_FILTER = 0.25
"""The filter's time constant times the expected angular frequency."""
_SLOWEST_FILTER_S = 0.05
_PATIENCE = 3.0
"""Half-cycle durations without a turning point that mean quiet."""
_KEPT = 40
"""Number of stored turning points."""
_GROWN = ((3, 0.50), (4, 0.50), (6, 0.50), (8, 0.55))
"""Numbers of explained half-cycles, and growth of the amplitude's logarithm over them that raises
an alarm."""
_STRAIGHT, _STRAIGHT_COUNTS = 0.01, 0.2
"""Largest scatter of it about a straight line; the second per amplitude in counts."""
_LEAST_COUNTS = 8.0
"""Amplitude from which growth is distinguished from the encoder's steps."""
_OUTWARD, _EACH = 0.4, 0.5
"""Growth of the distance from the wall over at least two explained half-cycles that raises an
alarm, and the fraction of its mean that each of the last two must have."""
_ON = 0.6
"""Fraction of the mean growth that the last half-cycle must have."""
_LONG = ((16, 0.28), (24, 0.28))
"""The same as ``_GROWN``, for growth more regular than a hand's."""
_UNPAID = ((8, 0.64), (24, 0.7))
"""The same where only the inertia fits, because delay or friction differ much from the belief."""
_UNPAID_COUNTS, _UNPAID_STEPS = 16.0, 0.1
"""Least amplitude for that, and its scatter per amplitude in counts."""
_REGULAR, _REGULAR_COUNTS = 0.008, 0.2
"""Scatter of the amplitude's logarithm that no hand achieves; the second per amplitude in counts.
"""
_STEADY = 0.01
"""Negligible growth per half-cycle, also the largest loss of a sustained oscillation."""
_SHRINKS = 0.04
"""Loss per half-cycle, over two, that ends an alarm."""
_ALARMING = 3.5
"""Least amplitude of an alarm [counts]: a lightly damped wall of any stiffness sustains one or two
by its encoder's steps alone."""
_FIRST_WAY, _LATER_WAY = 8.0, 14.0
"""Travel before the wall's energy is judged [counts]: from rest, and in later half-cycles, in which
a hand may take part."""
_SYMMETRIC = 0.9
"""Largest logarithm of the ratio of a half-cycle to the one before."""


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


class Detector:
    """Judges position and acting torque, sample by sample.

    Attributes:
        state: Of the motion now.
        frequency_hz: Of the oscillation [Hz]; NaN while there is none.
        amplitude: Half its width [rad]; 0 while there is none.
        growth: Rate at which the amplitude's logarithm grows [1/s]; NaN while there is none.
        alarm: It is sustained or grows, and the wall feeds it.
        balance: The energy balance; its ``surface``, ``side`` and ``lag`` may be set at any time.
    """

    def __init__(self, settings: DetectorSettings) -> None:
        self.settings = settings
        step = settings.position_step
        self._step = step if step > 0.0 else 0.0
        self._least = math.log(_LEAST_COUNTS * self._step) if step > 0.0 else -math.inf
        self.balance = EnergyBalance(
            settings.period,
            settings.inertia,
            settings.damping,
            settings.coulomb,
            settings.position_step,
            settings.torque_limit,
        )
        self._sums: HalfCycleSums | None = None
        self._before: HalfCycle | None = None
        self._mixed = self._blind = False
        self._streaks = Streaks()
        self._sizes: deque[float] = deque(maxlen=_KEPT)
        self._times: deque[float] = deque(maxlen=_KEPT)
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
        self._mixed = True  # the spring's energy is not what it was at the turning point
        self._refilter()

    def _refilter(self) -> None:
        if self._sums is not None and self.balance.natural > 0.0:
            self._sums.filter(min(_FILTER / self.balance.natural, _SLOWEST_FILTER_S))

    @property
    def energy(self) -> tuple[float, float]:
        """Return the torque's work [J] and the integrated squared velocity [rad²/s]."""
        sums = self._sums
        return (0.0, 0.0) if sums is None else (sums.work, sums.square)

    def restart(self) -> None:
        """Discard all observations."""
        self._sums = None
        self._quiet()

    def _quiet(self) -> None:
        self.state = State.QUIET
        self.alarm = False
        self.frequency_hz = math.nan
        self.amplitude = 0.0
        self.growth = math.nan
        self._patience = math.inf
        self._gives = True  # whether nothing speaks against it that the wall gives out energy
        self._way = _FIRST_WAY * self._step
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
            periods: From the last sample to this one, >= 1.
        """
        sums = self._sums
        if math.isnan(torque):
            torque, self._blind = 0.0, True
        if sums is None:
            self._sums = HalfCycleSums(self.settings.period, self._step, position)
            self._refilter()
            return self.state
        if sums.update(position, torque, periods):
            earlier = sums.before
            half_cycle = sums.half_cycle()
            if half_cycle is not None:
                self._take(half_cycle)
                if self._gives and self.balance.side and not (self.alarm or self._torn):
                    way = half_cycle.path + abs(half_cycle.start - earlier[0])
                    if way > 2.0 * self._way:
                        self._check(self.balance.gives_out(sums.since, earlier, way, 0.0))
            self._mixed = self._blind = False
        elif sums.time > self._patience:
            self._quiet()
        elif self._gives and not (self.alarm or self.balance.side or self._torn):
            since = sums.since
            way = abs(sums.position - since[0])
            if way > self._way:
                self._check(self.balance.gives_out(sums.now(), since, way, sums.speed))
        return self.state

    @property
    def _torn(self) -> bool:
        """Whether the present half-cycle's energy is unknown."""
        return self._mixed or self._blind

    def _check(self, gives_out: bool) -> None:
        if gives_out:
            self.alarm = True
            self.state = State.GROWING
            self.growth = self.balance.growth
            if math.isnan(self.frequency_hz):
                self.frequency_hz = self.balance.natural / (2.0 * math.pi)

    def _take(self, half_cycle: HalfCycle) -> None:
        """Process a half-cycle."""
        self._patience = half_cycle.ended + _PATIENCE * half_cycle.duration
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
        alike = abs(change) <= _SYMMETRIC
        moved = blind or (balance.moves and not self._mixed)
        streaks.take(
            moved=moved and alike,
            explained=alike and (blind or (moved and balance.pays)),
            share=1.0 if blind else balance.share,
            left=0.0 if blind else balance.left,
            fine=fine,
        )
        streaks.went_outward(self._outward(half_cycle) if streaks.explained else 0.0)
        self._way = _LATER_WAY * self._step
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
            self.growth = (size - sizes[-1 - back]) / passed
        if self.alarm:
            self._alarmed(fine)
        elif self._regular(fine) or (not (blind or balance.side) and self._grown()):
            self.alarm = half_cycle.amplitude >= _ALARMING * self._step
            self.state = State.SUSTAINED
            if self.alarm:
                self._alarmed(fine)
        elif streaks.explained >= 2 and change < -_STEADY:
            self.state = State.DECAYING
        elif not streaks.explained:
            self.state = State.QUIET

    def _outward(self, half_cycle: HalfCycle) -> float:
        """Return the growth of the distance from a two-sided wall, as a logarithm."""
        surface = self.balance.surface
        start, end = half_cycle.start - surface, half_cycle.end - surface
        least = _LEAST_COUNTS * self._step
        if start * end < 0.0 and abs(start) > least and abs(end) > least:
            return math.log(abs(end / start))
        return 0.0

    def _grown(self) -> bool:
        streaks = self._streaks
        if streaks.outward >= 2 and streaks.grown > _OUTWARD and streaks.least_outward > _EACH:
            return True
        sizes = self._sizes
        for half_cycles, growth in _GROWN:
            if streaks.explained < half_cycles:
                return False
            known = min(half_cycles + 1, len(sizes))
            first = sizes[-known]
            grown = sizes[-1] - first
            # A motion that grows by itself continues to grow; a hand's motion stops growing.
            last = sizes[-1] - sizes[-2]
            if first > self._least and grown > growth and last > _ON * grown / half_cycles:
                straight = _STRAIGHT + _STRAIGHT_COUNTS * self._step * math.exp(-first)
                if line(sizes, known).scatter < straight:
                    return True
        return False

    def _regular(self, fine: float) -> bool:
        """Whether it grows slowly, or persists, more regularly than a hand can."""
        sizes, least, streaks = self._sizes, self._least, self._streaks
        allowed = _REGULAR + _REGULAR_COUNTS * fine
        if self.balance.side and sizes[-1] > least and bounces_grow(sizes, streaks.moved):
            return True
        if grows_evenly(sizes, _LONG, streaks.explained, least, allowed):
            return True
        if not (self._blind or self.balance.side or math.isnan(self.settings.inertia)):
            least += math.log(_UNPAID_COUNTS / _LEAST_COUNTS)
            even = _REGULAR + _UNPAID_STEPS * fine
            if grows_evenly(sizes, _UNPAID, min(streaks.moved, streaks.even), least, even):
                return True
        return streaks.explained >= _KEPT and goes_on(sizes, allowed)

    def _alarmed(self, fine: float) -> None:
        sizes = self._sizes
        back = min(len(sizes) - 1, 2)
        change = (sizes[-1] - sizes[-1 - back]) / back if back else 0.0
        if change < -_SHRINKS - fine:
            self.alarm = False
            self.state = State.DECAYING
            self._streaks.clear()
        else:
            self.state = State.GROWING if change > _STEADY + fine else State.SUSTAINED
