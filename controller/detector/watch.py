"""Watches the running wall for an oscillation of its own making, and answers it.

``report`` only tells. ``reduce`` puts damping in, as much as does not lower the critical stiffness,
and lowers the stiffness, step by step until the motion decays; where that does not help, stiffness
and damping go toward the origin together. What was taken comes back only on request. Where nothing
helps, and in ``trip``, the run ends. The torque itself is never limited in its rate: that would be
one more delay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from math import isnan
from typing import Literal

from controller.detector.acting import ActingTorque
from controller.detector.backstop import BackstopSettings
from controller.detector.oscillation import Detector, DetectorSettings, State
from controller.detector.own_motion import OwnMotion
from controller.detector.retreat import Swing, softer
from controller.wall import Law

Answer = Literal["report", "reduce", "trip"]

LEAST_SHARE = 1.0 / 64.0
"""Of the decision's stiffness. What still oscillates at less is not the wall's doing."""
GIVEN, BOUNCES = 0.02, 1.5
"""Energy that a one-sided wall may give out in a bounce beyond what it took and what friction may
eat [J]; and the time after the entry in which it counts, in half-cycles of the heaviest servo"""
_OUTGROWN = 1.25
"""So much further than before the alarm is more than passivity control can hold [1]"""
_STIFFNESS_ALONE = 2
"""Steps in which the damping is not lowered"""
_LONGEST_S = 0.5
"""The next step is waited for at most so long, however slow the oscillation [s]."""


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
        share: Of the guard's stiffness that may be commanded [1].
        damping_share: Of its damping.
        damps: As much damping is to be put in as does not lower the critical stiffness.
        steps: Of the reduction, taken so far.
        taken_back: Alarms that were taken back, since a hand was found to move the shaft.
        failed: The run must end: the answer is ``trip``, or reducing has not helped.
        state: The worst seen.
        frequency_hz: Of the largest oscillation in that state, before the wall was reduced [Hz];
            NaN: none was seen.
        amplitude: Of it [rad].
        first_alarm_s: When the first alarm came, from when the wall went on [s]; NaN: none has.
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
        "_wait",
        "acted",
        "amplitude",
        "commanded",
        "current",
        "damping_share",
        "damps",
        "failed",
        "first_alarm_s",
        "frequency_hz",
        "own",
        "share",
        "spanned",
        "state",
        "steps",
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
        self._wait = 0
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
        self.share = self.damping_share = 1.0
        self.damps = False
        self.steps = self.taken_back = 0
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
                self.first_alarm_s = self._ticks * self._period
            if not self._settings.patient or self._outgrown(position - law.position):
                self._answer()
        else:
            self._size = math.nan

    def _backstop(self, own: OwnMotion, away: float, stiffness: float) -> None:
        """Watch what the believed values do not explain, and the energy of a contact."""
        moved = own.counts[1]
        own.update(away, self._sent, self.spanned * self._period, stiffness)
        if own.counts[1] > moved:
            self._take_back()
        if own.alarm or own.steady:
            self.current = max(self.current, State.GROWING if own.alarm else State.SUSTAINED)
            self._note(self.current, own.amplitude, own.frequency_hz)
            if own.alarm and isnan(self.first_alarm_s):
                self.first_alarm_s = self._ticks * self._period
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
        self.share = self.damping_share = 1.0
        self.damps = False
        self.steps = 0
        self._wait = 0
        self._detector.restart()

    def resume(self) -> None:
        """Begin to watch anew after a pause without torque; what an alarm took stays taken."""
        self._detector.restart()
        if self.own is not None:
            self.own.resume()
        self._entered = None
        self.damps = False
        self.current = State.QUIET
        self._position = self._size = math.nan
        self._last_move = self._mean = 0.0
        self._periods = 0

    def _take_back(self) -> None:
        """Allow what an alarm took: a probe has found that somebody moves the shaft."""
        if self.steps or self._detector.alarm:
            self.taken_back += 1
            self.share = self.damping_share = 1.0
            self.damps = False
            self.steps = self._wait = 0
            self._detector.restart()
        if self.own is not None and self.own.counts[2] == self.own.counts[3]:
            self.state, self.frequency_hz, self.amplitude, self.first_alarm_s = self._before

    @property
    def _acts(self) -> bool:
        return self._settings.answer != "report"

    @property
    def scale(self) -> float:
        """Of the wall's elastic torque and of its limit, while the backstop answers [1]."""
        return 1.0 if self.own is None else self.own.scale

    @property
    def damping_scale(self) -> float:
        """Of its damping [1]."""
        return 1.0 if self.own is None else self.own.damping_scale

    def _note(self, state: State, amplitude: float, frequency_hz: float) -> None:
        larger = amplitude > self.amplitude and self.share == 1.0
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
        answer = self._settings.answer
        if answer == "trip":
            self.failed = True
        if answer != "reduce":
            return
        self.damps = self.steps <= _STIFFNESS_ALONE
        if self._ticks < self._wait:
            return
        if self.share <= LEAST_SHARE:
            self.failed = True
            return
        if self.own is not None and self.own.large:
            if not self.own.answering and not self.own.suspected:
                self.own.suspect()
            return  # a probe says whether the wall moves the shaft, and then goes on by itself
        detector = self._detector
        hertz = detector.frequency_hz
        delay = self._acting.lag + self._settings.inserted / self._period
        if self.steps and detector.growth < 0.0:
            return  # the step before has done enough; it dies slowly
        step = softer(
            Swing(
                growth=detector.growth,
                frequency_hz=hertz,
                amplitude=detector.amplitude,
                past_s=(self._since_turn + delay) * self._period,
            ),
            self._settings.detector,
            detector.stiffness,
            self._damping,
            delay * self._period,
        )
        if step is None:
            return
        self.share = max(LEAST_SHARE, self.share * step)
        self.steps += 1
        if self.steps > _STIFFNESS_ALONE:
            self.damps = False
            self.damping_share = max(LEAST_SHARE, self.damping_share * step)
        # A cycle of the softer spring: the first swing after a step is larger by what it changed.
        cycle_s = 1.0 / (hertz * math.sqrt(step)) if hertz > 0.0 else _LONGEST_S
        self._wait = self._ticks + math.ceil(min(cycle_s, _LONGEST_S) / self._period)


def oscillation_report(watch: Watch) -> dict[str, object]:
    """What was seen, for the report: None for what there was not."""
    seen = watch.state > State.QUIET
    alarmed = not isnan(watch.first_alarm_s)
    known = seen and math.isfinite(watch.frequency_hz)
    return {
        "state": watch.state.name.lower(),
        "frequency_hz": watch.frequency_hz if known else None,
        "amplitude_rad": watch.amplitude if seen else None,
        "first_alarm_s": watch.first_alarm_s if alarmed else None,
        "reduced_to": {
            "stiffness": watch.share * watch.scale,
            "damping": watch.damping_share * watch.damping_scale,
        },
        "backlash": watch.own is not None and watch.own.backlash,
    }
