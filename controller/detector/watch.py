"""The oscillation watch: runs detector and backstop in each tick, and acts on their alarms.

Two parts judge the motion. The detector uses the believed values, is fast, and may be wrong about a
hand where their bounds are wide. The backstop uses no belief: it probes the wall. ``report`` only
reports. ``reduce`` has an alarm of the detector probed, and leaves the reduction to the backstop;
the gains return only on request, or where a hand turns out to have moved the shaft. ``trip`` ends
the run at an alarm of either. The torque's rate is never limited: that would add delay.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from math import isnan
from typing import Literal

from haptic_wall.controller.detector.acting import ActingTorque
from haptic_wall.controller.detector.backstop_settings import BackstopSettings
from haptic_wall.controller.detector.oscillation import Detector, DetectorSettings, State
from haptic_wall.controller.detector.own_motion import OwnMotion
from haptic_wall.controller.laws.wall import Law

Answer = Literal["report", "reduce", "trip"]
_OUTRUNS = 1.5
"""How much faster than the fastest motion on the wall's spring a vibration of a link is, at least:
late damping stiffens the spring"""
_NOT_JUDGED = 0.0, 0.0, -math.inf
"""Of a contact that the watch has not seen begin: the wall may give what it held before"""


@dataclass(frozen=True, slots=True)
class WatchSettings:
    """The watch's knowledge, and its permitted actions."""

    detector: DetectorSettings
    answer: Answer
    lag: float
    """Believed lag, from sending a torque until it acts [s]"""
    inserted: float = 0.0
    """Inserted delay, from computing a torque to sending it [s]"""
    patient: bool = False
    """Passivity control acts: an alarm is answered only when the motion outgrows it"""
    side: int = 0
    """0: the wall is two-sided; +1 or -1: it fills the positions above or below it"""
    backstop: BackstopSettings | None = None
    """When the wall is probed; None: only after an alarm of the detector"""
    bounces: BackstopSettings | None = None
    """The same for the contacts with a one-sided wall"""
    damping_high: float = 0.0
    """Largest believed viscous friction, in commanded torque [N·m·s/rad]"""
    heavy: float = 0.0
    """Largest believed inertia, in commanded torque [kg·m²]"""
    light: float = 0.0
    """Least believed inertia, in commanded torque [kg·m²]"""
    elongation: Callable[[float], float] | None = None
    """Elongation of a law that is not linear: that of a linear spring with the same energy, over
    position [rad]. Such a law holds no load while it is softened."""


class Watch:
    """Runs the detector on the acting torque and the backstop, and answers their alarms.

    Attributes:
        taken_back: Number of alarms taken back because a hand was found to move the shaft.
        failed: The run must end: the answer is ``trip``, or reducing has not helped.
        state: The worst state so far.
        frequency_hz: Frequency of the largest oscillation in that state, before the wall was
            reduced [Hz]; NaN: none.
        amplitude: Of it [rad].
        first_alarm_s: Time of the first alarm's sample, from the first with the wall on [s]; NaN:
            none.
        current: State of the motion now.
        acted: Mean torque that acted between the last two samples [N·m].
        commanded: The same in commanded torque, where ``acted`` was measured [N·m].
        spanned: Periods between them.
        own: Results of the backstop; None: there is none.
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
        "_size",
        "_stiffness",
        "_ticks",
        "_tuning",
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
        self._tuning = settings.detector.tuning
        self._detector = Detector(settings.detector)
        self._detector.balance.side = settings.side
        self._detector.balance.elongation = settings.elongation
        self._acting = ActingTorque(0.0)
        self._mean = 0.0
        self._periods = 0
        self._ticks = 0
        self._damping = 0.0
        self._position = math.nan
        self._last_move = 0.0
        self._turned_at = 0.0
        self._size = math.nan
        self._stiffness = math.nan
        self._sent = 0.0
        self._entered: tuple[float, float, float] | None = _NOT_JUDGED
        self.own: OwnMotion | None = None
        if settings.backstop is not None:
            self.own = OwnMotion(
                settings.backstop, settings.bounces, settings.side, settings.elongation
            )
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
        """Set the age of a sample when its torque is sent [s]."""
        lag_s = age_s + self._settings.lag
        self._acting.lag = lag_s / self._period
        self._detector.balance.lag = lag_s + self._settings.inserted

    def passed(self, periods: int) -> None:
        """Count a tick, ``periods`` after the last one."""
        self._mean += self._acting.acted(periods) * periods
        self._periods += periods
        self._ticks += periods

    def sent(self, torque: float) -> None:
        """Store the torque that the tick has sent [N·m]."""
        self._acting.send(torque)
        self._sent = torque

    def sample(self, position: float, law: Law, measured: float) -> None:
        """Take a new position, in a tick counted by ``passed``.

        Args:
            position: [rad]
            law: The rendered law, with its stiffness, damping and position.
            measured: Torque from the servo's current [N·m]; NaN: it gives none.
        """
        self.spanned = periods = self._periods
        self.commanded = commanded = self._mean / periods
        self.acted = torque = commanded if isnan(measured) else measured
        self._mean = 0.0
        self._periods = 0
        detector = self._detector
        derating = law.derating
        stiffness = law.stiffness * derating.scale
        if stiffness != self._stiffness:
            self._stiffness = detector.stiffness = stiffness
        balance = detector.balance
        damping = (law.damping + law.injected) * derating.damping_scale
        balance.virtual_damping = self._damping = damping
        balance.surface = law.position
        balance.held = law.held
        self.current = state = detector.update(position, torque, periods)
        if not detector.alarm and isnan(self.first_alarm_s):
            self._before = self.state, self.frequency_hz, self.amplitude, math.nan
        if state:
            self._note(state, detector.amplitude, detector.frequency_hz)
        if self.own is not None:
            self._backstop(self.own, position - law.position, law)
        self._follow(position, law.position)
        if detector.alarm:
            if isnan(self.first_alarm_s):
                self.first_alarm_s = (self._ticks - 1) * self._period
            if not self._settings.patient or self._outgrown(position - law.position):
                self._answer()
        else:
            self._size = math.nan

    def _backstop(self, own: OwnMotion, away: float, law: Law) -> None:
        """Watch motion that the believed values do not explain, and the energy of a contact."""
        moved = own.moved
        damping = law.damping + law.injected
        own.update(away, self._sent, self.spanned * self._period, law.stiffness, damping)
        if own.moved > moved:
            self._take_back()
        if own.alarm or own.steady:
            self.current = max(self.current, State.GROWING if own.alarm else State.SUSTAINED)
            amplitude, frequency_hz = own.amplitude, own.frequency_hz
            if (asked := own.asked) is not None:
                amplitude, frequency_hz = asked.amplitude, 1.0 / asked.cycle
            self._note(self.current, amplitude, frequency_hz)
            if own.alarm and isnan(self.first_alarm_s):
                self.first_alarm_s = (self._ticks - 1) * self._period
        if own.failed or (own.alarm and self._settings.answer == "trip"):
            self.failed = True
        side = self._settings.side
        if side:
            self._contact(away * side > 0.0)

    def _contact(self, inside: bool) -> None:
        """Trip where the wall has given much more energy in a bounce than it has taken.

        A bounce lasts half a cycle. Only about one and a half of them after the entry are judged: a
        hand that moves to and fro inside the wall takes energy from it without a limit, and
        friction dissipates it.
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
            if (self._ticks - ticks_then) * self._period < self._tuning.contacts.bounce * bounce:
                eaten = self._settings.damping_high * (square - square_then)
                given = work - work_then - eaten
                self.failed = self.failed or given > self._tuning.watch.given_j

    def raise_again(self) -> None:
        """Restore the guard's gains, and restart the watch."""
        if self.own is not None:
            self.own.raise_again()
        self._restart()

    def _restart(self) -> None:
        """Discard the detector's observations, with the energies since the entry of a contact."""
        self._detector.restart()
        if self._entered is not None:
            self._entered = _NOT_JUDGED

    def resume(self) -> None:
        """Restart the watch after a pause without torque; reductions stay."""
        self._detector.restart()
        if self.own is not None:
            self.own.resume()
        self._entered = _NOT_JUDGED
        self.current = State.QUIET
        self._position = self._size = math.nan
        self._last_move = self._mean = 0.0
        self._periods = 0

    def change(self, settings: WatchSettings, moved_by: float, *, another: bool) -> None:
        """Watch another law from now on; earlier reports stay.

        The backstop goes on: else a law that is changed again and again would never be found to
        oscillate.

        Args:
            settings: Settings of the law.
            moved_by: Way from the position of the law before [rad].
            another: The law is not the same with other gains or at another position.
        """
        self._settings = settings
        balance = self._detector.balance
        balance.side, balance.elongation = settings.side, settings.elongation
        own = self.own
        if own is not None:
            own.become(settings.bounces, settings.side, settings.elongation)
            own.shift(moved_by)
        if another or moved_by:
            self._restart()

    def _take_back(self) -> None:
        """Take an alarm of the detector back: a probe has found that a hand moves the shaft."""
        if self._detector.alarm:
            self.taken_back += 1
            self._restart()
        if self.own is not None and self.own.counts[2] == self.own.counts[3]:
            self.state, self.frequency_hz, self.amplitude, self.first_alarm_s = self._before

    @property
    def _acts(self) -> bool:
        return self._settings.answer != "report"

    @property
    def seen(self) -> tuple[float, float, bool]:
        """Return frequency [Hz] and amplitude [rad] now, and an alarm."""
        detector, own = self._detector, self.own
        if own is not None and (own.alarm or own.steady) and detector.state < State.SUSTAINED:
            return own.frequency_hz, own.amplitude, own.alarm or detector.alarm
        alarm = detector.alarm or (own is not None and own.alarm)
        return detector.frequency_hz, detector.amplitude, alarm

    def outruns(self, stiffness: float) -> bool:
        """Whether the motion is faster than that of any believed servo on the wall's spring.

        Then a link vibrates, whatever is believed of one.

        Args:
            stiffness: K without a derating [N·m/rad].
        """
        own, light = self.own, self._settings.light
        if own is None:
            return False
        if not stiffness > 0.0:
            return own.is_faster(math.inf)
        return own.is_faster(math.pi * math.sqrt(light / stiffness) / _OUTRUNS)

    @property
    def scale(self) -> float:
        """Return the scale of the wall's elastic torque and of its limit, by the backstop [1]."""
        return 1.0 if self.own is None else self.own.scale

    @property
    def carried(self) -> float:
        """Return the torque about which the spring is softened [N·m]: it holds a load."""
        return 0.0 if self.own is None else self.own.hold.torque

    @property
    def carried_to(self) -> float:
        """Return the distance from the surface up to which it acts in full [rad]."""
        return 0.0 if self.own is None else self.own.hold.reach

    @property
    def soft_to(self) -> float:
        """Return the distance from the surface up to which the spring's limit is scaled [rad]."""
        return 0.0 if self.own is None else self.own.hold.deep

    @property
    def damping_scale(self) -> float:
        """Return the scale of its damping [1]."""
        return 1.0 if self.own is None else self.own.damping_scale

    def _note(self, state: State, amplitude: float, frequency_hz: float) -> None:
        larger = amplitude > self.amplitude and self.scale == 1.0
        if state > self.state or (state == self.state and larger):
            self.state = state
            self.amplitude = amplitude
            self.frequency_hz = frequency_hz

    def _follow(self, position: float, surface: float) -> None:
        """Record when, and how far from the wall, the motion last reversed."""
        moved = position - self._position
        if isnan(moved):
            self._turned_at = abs(position - surface)
        elif moved:
            if moved * self._last_move < 0.0:
                self._turned_at = abs(self._position - surface)
            self._last_move = moved
        self._position = position

    def _outgrown(self, away: float) -> bool:
        """Whether the motion goes clearly further than before the alarm."""
        if isnan(self._size):
            self._size = self._turned_at + 2.0 * self._settings.detector.position_step
        return abs(away) > self._tuning.watch.outgrown * self._size

    def _answer(self) -> None:
        """Answer an alarm of the believed values: end the run, or have the wall probed."""
        if self._settings.answer == "trip":
            self.failed = True
        own = self.own
        if own is not None and not (own.answering or own.suspected):
            own.suspect()


def oscillation_report(watch: Watch) -> dict[str, object]:
    """Return the observations for the report: None for missing ones."""
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
