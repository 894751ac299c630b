"""Watches the running wall for an oscillation of its own making, and answers it.

Two look at the motion. The detector knows the believed values, is quick, and may be wrong about a
hand where they are wide. The backstop believes nothing: it probes the wall. ``report`` only tells.
``reduce`` has an alarm of the detector probed, and leaves the reduction to the backstop; what it
took comes back only on request, or where a hand turns out to have moved the shaft. ``trip`` ends
the run at an alarm of either. The torque itself is never limited in its rate: that would be one
more delay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from math import isnan
from typing import Literal

from haptic_wall.controller.detector.acting import ActingTorque
from haptic_wall.controller.detector.backstop import BackstopSettings
from haptic_wall.controller.detector.oscillation import Detector, DetectorSettings, State
from haptic_wall.controller.detector.own_motion import OwnMotion
from haptic_wall.controller.laws.wall import Law

Answer = Literal["report", "reduce", "trip"]

GIVEN, BOUNCES = 0.02, 1.5
"""Energy that a one-sided wall may give out in a bounce beyond what it took and what friction may
eat [J]; and the time after the entry in which it counts, in half-cycles of the heaviest servo"""
_OUTGROWN = 1.25
"""So much further than before the alarm is more than passivity control can hold [1]"""


@dataclass(frozen=True, slots=True)
class WatchSettings:
    """What the watch knows, and what it is to do."""

    detector: DetectorSettings
    answer: Answer
    lag: float
    """From a torque's being sent to its action, believed [s]"""
    inserted: float = 0.0
    """From a torque's being computed to its being sent [s]"""
    patient: bool = False
    """Passivity control acts: an alarm is answered only when the motion outgrows it"""
    side: int = 0
    """0: the wall is two-sided; +1 or -1: it fills the positions above or below it"""
    backstop: BackstopSettings | None = None
    """When the wall is probed; None: only where the believed values say so"""
    bounces: BackstopSettings | None = None
    """The same for the contacts with a one-sided wall"""
    damping_high: float = 0.0
    """Largest viscous friction that is believed, torque as commanded [N·m·s/rad]"""
    heavy: float = 0.0
    """Largest inertia that is believed, likewise [kg·m²]"""


class Watch:
    """The detector on the torque that acts, and what is done about an alarm.

    Attributes:
        taken_back: Alarms that were taken back, since a hand was found to move the shaft.
        failed: The run must end: the answer is ``trip``, or reducing has not helped.
        state: The worst seen.
        frequency_hz: Of the largest oscillation in that state, before the wall was reduced [Hz];
            NaN: none was seen.
        amplitude: Of it [rad].
        first_alarm_s: When the sample came that raised the first alarm, from the first with the
            wall on [s]; NaN: none has.
        current: What the motion does now.
        acted: Mean torque that acted between the last two samples [N·m].
        commanded: The same by what was commanded, where ``acted`` was measured [N·m].
        spanned: Periods between them.
        own: What the backstop has seen; None: there is none.
    """

    __slots__ = (
        "_acting",
        "_before",
        "_damping",
        "_detector",
        "_entered",
        "_last_move",
        "_mean",
        "_period",
        "_periods",
        "_position",
        "_sent",
        "_settings",
        "_since_turn",
        "_size",
        "_stiffness",
        "_ticks",
        "_turned_at",
        "acted",
        "amplitude",
        "commanded",
        "current",
        "failed",
        "first_alarm_s",
        "frequency_hz",
        "own",
        "spanned",
        "state",
        "taken_back",
    )

    def __init__(self, settings: WatchSettings) -> None:
        self._settings = settings
        self._period = settings.detector.period
        self._detector = Detector(settings.detector)
        self._detector.balance.side = settings.side
        self._acting = ActingTorque(0.0)
        self._mean = 0.0
        self._periods = 0
        self._ticks = 0
        self._damping = 0.0
        self._position = math.nan
        self._last_move = 0.0
        self._since_turn = 0
        self._turned_at = 0.0
        self._size = math.nan
        self._stiffness = math.nan
        self._sent = 0.0
        self._entered: tuple[float, float, int] | None = None
        self.own: OwnMotion | None = None
        if settings.backstop is not None:
            self.own = OwnMotion(settings.backstop, settings.bounces, settings.side)
        self.acted = self.commanded = 0.0
        self.spanned = 1
        self.taken_back = 0
        self.failed = False
        self.current = self.state = State.QUIET
        self.frequency_hz = math.nan
        self.amplitude = 0.0
        self.first_alarm_s = math.nan
        self._before = self.state, self.frequency_hz, self.amplitude, math.nan

    def set_age(self, age_s: float) -> None:
        """Say how old a sample is when its torque is sent [s]."""
        lag_s = age_s + self._settings.lag
        self._acting.lag = lag_s / self._period
        self._detector.balance.lag = lag_s + self._settings.inserted

    def passed(self, periods: int) -> None:
        """A tick has come, ``periods`` after the one before."""
        self._mean += self._acting.acted(periods) * periods
        self._periods += periods
        self._ticks += periods

    def sent(self, torque: float) -> None:
        """Keep the torque that the tick has sent [N·m]."""
        self._acting.send(torque)
        self._sent = torque

    def sample(self, position: float, law: Law, measured: float) -> None:
        """Take a new position, in the tick that ``passed`` has told of.

        Args:
            position: [rad]
            law: What is rendered, for its stiffness, damping and place.
            measured: Torque from the servo's current [N·m]; NaN: it gives none.
        """
        self.spanned = periods = self._periods
        self.commanded = commanded = self._mean / periods
        self.acted = torque = commanded if isnan(measured) else measured
        self._mean = 0.0
        self._periods = 0
        detector = self._detector
        stiffness = law.stiffness * law.scale
        if stiffness != self._stiffness:
            self._stiffness = detector.stiffness = stiffness
        balance = detector.balance
        balance.virtual_damping = self._damping = (law.damping + law.injected) * law.damping_scale
        balance.surface = law.position
        self.current = state = detector.update(position, torque, periods)
        if not detector.alarm and isnan(self.first_alarm_s):
            self._before = self.state, self.frequency_hz, self.amplitude, math.nan
        if state:
            self._note(state, detector.amplitude, detector.frequency_hz)
        if self.own is not None:
            self._backstop(self.own, position - law.position, law.stiffness)
        self._follow(position, law.position, periods)
        if detector.alarm:
            if isnan(self.first_alarm_s):
                self.first_alarm_s = (self._ticks - 1) * self._period
            if not self._settings.patient or self._outgrown(position - law.position):
                self._answer()
        else:
            self._size = math.nan

    def _backstop(self, own: OwnMotion, away: float, stiffness: float) -> None:
        """Watch what the believed values do not explain, and the energy of a contact."""
        moved = own.moved
        own.update(away, self._sent, self.spanned * self._period, stiffness)
        if own.moved > moved:
            self._take_back()
        if own.alarm or own.steady:
            self.current = max(self.current, State.GROWING if own.alarm else State.SUSTAINED)
            self._note(self.current, own.amplitude, own.frequency_hz)
            if own.alarm and isnan(self.first_alarm_s):
                self.first_alarm_s = (self._ticks - 1) * self._period
        if own.failed or (own.alarm and self._settings.answer == "trip"):
            self.failed = True
        side = self._settings.side
        if side:
            self._contact(away * side > 0.0)

    def _contact(self, inside: bool) -> None:
        """Trip where the wall has given out much more in a bounce than it has taken.

        A bounce lasts half a cycle. Only about one and a half of them after the entry are judged:
        a hand that moves to and fro inside of the wall takes energy from it for as long as it
        likes, and friction eats it.
        """
        work, square = self._detector.energy
        if not inside:
            self._entered = None
            return
        if self._entered is None:
            self._entered = work, square, self._ticks
        work_then, square_then, ticks_then = self._entered
        if self._stiffness > 0.0 and self._acts:
            bounce = math.pi * math.sqrt(self._settings.heavy / self._stiffness)
            if (self._ticks - ticks_then) * self._period < BOUNCES * bounce:
                eaten = self._settings.damping_high * (square - square_then)
                self.failed = self.failed or work - work_then - eaten > GIVEN

    def raise_again(self) -> None:
        """Allow all that the guard allows again, and begin to watch anew."""
        if self.own is not None:
            self.own.raise_again()
        self._detector.restart()

    def resume(self) -> None:
        """Begin to watch anew after a pause without torque; what an alarm took stays taken."""
        self._detector.restart()
        if self.own is not None:
            self.own.resume()
        self._entered = None
        self.current = State.QUIET
        self._position = self._size = math.nan
        self._last_move = self._mean = 0.0
        self._periods = 0

    def _take_back(self) -> None:
        """Take an alarm of the detector back: a probe has found that somebody moves the shaft."""
        if self._detector.alarm:
            self.taken_back += 1
            self._detector.restart()
        if self.own is not None and self.own.counts[2] == self.own.counts[3]:
            self.state, self.frequency_hz, self.amplitude, self.first_alarm_s = self._before

    @property
    def _acts(self) -> bool:
        return self._settings.answer != "report"

    @property
    def seen(self) -> tuple[float, float, float, bool]:
        """Frequency [Hz], amplitude [rad] and growth [1/s] of the motion now, and an alarm."""
        detector, own = self._detector, self.own
        if own is not None and (own.alarm or own.steady) and detector.state < State.SUSTAINED:
            return own.frequency_hz, own.amplitude, math.nan, own.alarm or detector.alarm
        alarm = detector.alarm or (own is not None and own.alarm)
        return detector.frequency_hz, detector.amplitude, detector.growth, alarm

    @property
    def scale(self) -> float:
        """Of the wall's elastic torque and of its limit, while the backstop answers [1]."""
        return 1.0 if self.own is None else self.own.scale

    @property
    def damping_scale(self) -> float:
        """Of its damping [1]."""
        return 1.0 if self.own is None else self.own.damping_scale

    def _note(self, state: State, amplitude: float, frequency_hz: float) -> None:
        larger = amplitude > self.amplitude and self.scale == 1.0
        if state > self.state or (state == self.state and larger):
            self.state = state
            self.amplitude = amplitude
            self.frequency_hz = frequency_hz

    def _follow(self, position: float, surface: float, periods: int) -> None:
        """Know when, and how far from the wall, the motion last went another way than before."""
        moved = position - self._position
        if isnan(moved):
            self._turned_at = abs(position - surface)
        elif moved:
            if moved * self._last_move < 0.0:
                self._since_turn = 0
                self._turned_at = abs(self._position - surface)
            self._last_move = moved
        self._position = position
        self._since_turn += periods

    def _outgrown(self, away: float) -> bool:
        """Whether the motion goes clearly further than before the alarm."""
        if isnan(self._size):
            self._size = self._turned_at + 2.0 * self._settings.detector.position_step
        return abs(away) > _OUTGROWN * self._size

    def _answer(self) -> None:
        """Answer an alarm of the believed values: end the run, or have the wall probed."""
        if self._settings.answer == "trip":
            self.failed = True
        own = self.own
        if own is not None and not (own.answering or own.suspected):
            own.suspect()


def oscillation_report(watch: Watch) -> dict[str, object]:
    """What was seen, for the report: None for what there was not."""
    seen = watch.state > State.QUIET
    alarmed = not isnan(watch.first_alarm_s)
    known = seen and math.isfinite(watch.frequency_hz)
    reduced = (1.0, 1.0) if watch.own is None else watch.own.reduced
    return {
        "state": watch.state.name.lower(),
        "frequency_hz": watch.frequency_hz if known else None,
        "amplitude_rad": watch.amplitude if seen else None,
        "first_alarm_s": watch.first_alarm_s if alarmed else None,
        "reduced_to": {
            "stiffness": reduced[0],
            "damping": reduced[1],
        },
        "backlash": watch.own is not None and watch.own.backlash,
    }
