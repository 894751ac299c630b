"""Notices that the loop oscillates by itself: quiet, decaying, sustained, growing.

Three questions, in the order in which they can be answered. Has the wall given out more energy
since the last turning point than friction can eat? Does the acting torque alone explain the motion,
swing after swing, while it grows? And if it does not grow: is it more regular than any hand?
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import IntEnum

from haptic_wall.controller.detector.energy import EnergyBalance
from haptic_wall.controller.detector.regularity import bounces_grow, goes_on, grows_evenly, line
from haptic_wall.controller.detector.streaks import Streaks
from haptic_wall.controller.detector.swings import Swing, Swings

_FILTER = 0.25
"""The filter's time constant, times the angular frequency expected."""
_SLOWEST_FILTER_S = 0.05
_PATIENCE = 3.0
"""As many swings without a turning point are quiet."""
_KEPT = 40
"""Turning points kept."""
_GROWN = ((3, 0.50), (4, 0.50), (6, 0.50), (8, 0.55))
"""Growth of the amplitude's logarithm over so many explained swings that is an alarm."""
_STRAIGHT, _STRAIGHT_COUNTS = 0.01, 0.2
"""Scatter that it may have about a straight line; the second per amplitude in counts."""
_LEAST_COUNTS = 8.0
"""Amplitude from which growth is told from the encoder's steps."""
_OUTWARD, _EACH = 0.4, 0.5
"""Growth of the distance from the wall over two explained swings or more that is an alarm, and the
share of its mean that either of the last two must have."""
_ON = 0.6
"""Share of the mean growth that the last swing must have."""
_LONG = ((16, 0.28), (24, 0.28))
"""The same where it must be as regular as no hand's."""
_UNPAID = ((8, 0.64), (24, 0.7))
"""And where only the inertia fits, because delay or friction are far from what is believed."""
_UNPAID_COUNTS, _UNPAID_STEPS = 16.0, 0.1
"""Amplitude from which that is told, and its scatter per amplitude in counts."""
_REGULAR, _REGULAR_COUNTS = 0.008, 0.2
"""Scatter of the amplitude's logarithm that no hand keeps up with; the second per amplitude in
counts."""
_STEADY = 0.01
"""Growth per swing that is none, and the most that a sustained oscillation may lose."""
_SHRINKS = 0.04
"""Loss per swing, over two, that ends an alarm."""
_ALARMING = 3.5
"""Counts from which an oscillation is worth an alarm: a lightly damped wall of any stiffness keeps
up one or two by its encoder's steps alone."""
_FIRST_WAY, _LATER_WAY = 8.0, 14.0
"""Counts to be travelled before what the wall gives out is judged: from rest, and in the swings
that follow, in which a hand may have a part."""
_SYMMETRIC = 0.9
"""Logarithm of the most that a swing may differ from the one before."""


class State(IntEnum):
    """What the loop does by itself; the worse, the greater. A hand's motion is quiet."""

    QUIET = 0
    DECAYING = 1
    SUSTAINED = 2
    GROWING = 3


@dataclass(frozen=True, slots=True)
class DetectorSettings:
    """What the detector knows of the servo; NaN: not known.

    Without inertia it goes by the motion alone.
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
    """Watches position and acting torque, sample by sample.

    Attributes:
        state: Of the motion now.
        frequency_hz: Of the oscillation [Hz]; NaN while there is none.
        amplitude: Half its width [rad]; 0 while there is none.
        growth: Rate at which the amplitude's logarithm grows [1/s]; NaN while there is none.
        alarm: Whether it is sustained or grows, and the wall feeds it.
        balance: What it believes of the wall; its ``surface``, ``side`` and ``lag`` may be set at
            any time.
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
        self._swings: Swings | None = None
        self._before: Swing | None = None
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
        if self._swings is not None and self.balance.natural > 0.0:
            self._swings.filter(min(_FILTER / self.balance.natural, _SLOWEST_FILTER_S))

    @property
    def energy(self) -> tuple[float, float]:
        """Work of the acting torque [J] and integral of the squared velocity [rad²/s], filtered."""
        swings = self._swings
        return (0.0, 0.0) if swings is None else (swings.work, swings.square)

    def restart(self) -> None:
        """Forget what was seen."""
        self._swings = None
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
            torque: Mean torque that acted since the sample before [N·m]; NaN: not known, and what
                it has to do with the motion is not judged.
            periods: From the sample before to this one, >= 1.
        """
        swings = self._swings
        if math.isnan(torque):
            torque, self._blind = 0.0, True
        if swings is None:
            self._swings = Swings(self.settings.period, self._step, position)
            self._refilter()
            return self.state
        if swings.update(position, torque, periods):
            earlier = swings.before
            swing = swings.swing()
            if swing is not None:
                self._swung(swing)
                if self._gives and self.balance.side and not (self.alarm or self._torn):
                    way = swing.path + abs(swing.start - earlier[0])
                    if way > 2.0 * self._way:
                        self._check(self.balance.gives_out(swings.since, earlier, way, 0.0))
            self._mixed = self._blind = False
        elif swings.time > self._patience:
            self._quiet()
        elif self._gives and not (self.alarm or self.balance.side or self._torn):
            since = swings.since
            way = abs(swings.position - since[0])
            if way > self._way:
                self._check(self.balance.gives_out(swings.now(), since, way, swings.speed))
        return self.state

    @property
    def _torn(self) -> bool:
        """Whether the present swing's energy cannot be told."""
        return self._mixed or self._blind

    def _check(self, gives_out: bool) -> None:
        if gives_out:
            self.alarm = True
            self.state = State.GROWING
            self.growth = self.balance.growth
            if math.isnan(self.frequency_hz):
                self.frequency_hz = self.balance.natural / (2.0 * math.pi)

    def _swung(self, swing: Swing) -> None:
        """Take a swing into account."""
        self._patience = swing.ended + _PATIENCE * swing.duration
        balance, blind, streaks = self.balance, self._blind, self._streaks
        if not blind:
            balance.judge(swing, self._before)
        self._before = None if blind else swing
        fine = self._step / swing.amplitude
        size = math.log(swing.amplitude)
        sizes, times = self._sizes, self._times
        change = size - sizes[-1] if sizes else 0.0
        sizes.append(size)
        times.append(swing.ended)
        alike = abs(change) <= _SYMMETRIC
        moved = blind or (balance.moves and not self._mixed)
        streaks.take(
            moved=moved and alike,
            explained=alike and (blind or (moved and balance.pays)),
            share=1.0 if blind else balance.share,
            left=0.0 if blind else balance.left,
            fine=fine,
        )
        streaks.went_outward(self._outward(swing) if streaks.explained else 0.0)
        self._way = _LATER_WAY * self._step
        if balance.side:
            self._gives = streaks.moved > 1
        else:
            self._gives = self._mixed or (balance.gave(swing) and (moved or len(sizes) == 1))
        known = len(sizes)
        self.amplitude = swing.amplitude
        back = min(known - 1, 4)
        self.frequency_hz = 0.5 / swing.duration
        if back:
            passed = swing.ended - times[-1 - back]
            self.frequency_hz = 0.5 * back / passed
            self.growth = (size - sizes[-1 - back]) / passed
        if self.alarm:
            self._alarmed(fine)
        elif self._regular(fine) or (not (blind or balance.side) and self._grown()):
            self.alarm = swing.amplitude >= _ALARMING * self._step
            self.state = State.SUSTAINED
            if self.alarm:
                self._alarmed(fine)
        elif streaks.explained >= 2 and change < -_STEADY:
            self.state = State.DECAYING
        elif not streaks.explained:
            self.state = State.QUIET

    def _outward(self, swing: Swing) -> float:
        """By how much its end is farther from a two-sided wall than its start, as a logarithm."""
        surface = self.balance.surface
        start, end = swing.start - surface, swing.end - surface
        least = _LEAST_COUNTS * self._step
        if start * end < 0.0 and abs(start) > least and abs(end) > least:
            return math.log(abs(end / start))
        return 0.0

    def _grown(self) -> bool:
        streaks = self._streaks
        if streaks.outward >= 2 and streaks.grown > _OUTWARD and streaks.least_outward > _EACH:
            return True
        sizes = self._sizes
        for swings, growth in _GROWN:
            if streaks.explained < swings:
                return False
            known = min(swings + 1, len(sizes))
            first = sizes[-known]
            grown = sizes[-1] - first
            # A motion that grows by itself grows on; a hand's has grown, and then stays.
            last = sizes[-1] - sizes[-2]
            if first > self._least and grown > growth and last > _ON * grown / swings:
                straight = _STRAIGHT + _STRAIGHT_COUNTS * self._step * math.exp(-first)
                if line(sizes, known).scatter < straight:
                    return True
        return False

    def _regular(self, fine: float) -> bool:
        """Whether it grows slowly, or goes on, more regularly than a hand can."""
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
