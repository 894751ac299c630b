"""The oscillation watch: runs the backstop in each tick, and answers its alarms.

``report`` only reports. ``reduce`` has the wall probed, and reduced if it makes the motion; the
gains return only on request. ``trip`` ends the run at the alarm, and at the early alarm: a motion
that the believed servo makes, and that grows. ``report`` has the early alarm too. The torque's rate
is never limited: that would add delay.
"""

from __future__ import annotations

import math
from math import isnan

from haptic_wall.controller.detector.acting import ActingTorque
from haptic_wall.controller.detector.backstop import Backstop, Shared
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.state import State
from haptic_wall.controller.laws.wall import Law

_STILL_GROWS = 1.02
"""Ratio of two amplitudes in a row from which an oscillation grows [1]"""


class Watch:
    """Feeds the backstop with the samples, and reports the worst state.

    Attributes:
        backstop: Probes and reduces the wall.
        failed: The run must end: the answer is ``trip``, or reducing has not helped.
        alarm: An alarm holds now.
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
        sent: Stores the torque that the tick has sent [N·m].
    """

    def __init__(self, settings: WatchSettings, shared: Shared | None = None) -> None:
        """Start to watch an axis; ``shared``: with the watches of the run's other axes."""
        self._settings = settings
        self._period = settings.period
        self._acting = ActingTorque()
        self.sent = self._acting.send
        self.backstop = Backstop(settings, shared)
        self._mean = 0.0
        self._periods = self._ticks = 0
        self.acted = self.commanded = 0.0
        self.spanned = 1
        self.alarm = self.failed = False
        self.current = self.state = State.QUIET
        self.frequency_hz = self.first_alarm_s = math.nan
        self.amplitude = 0.0

    def set_age(self, age_s: float) -> None:
        """Set the age of a sample when its torque is sent [s]."""
        self._acting.delay_by((age_s + self._settings.lag) / self._period)

    def passed(self, periods: int) -> None:
        """Count a tick without a new position, ``periods`` after the last one."""
        self._mean += self._acting.acted(periods) * periods
        self._periods += periods
        self._ticks += periods

    def sample(self, position: float, law: Law, measured: float, periods: int) -> None:
        """Take a new position, in a tick ``periods`` after the last one.

        Args:
            position: [rad]
            law: The rendered law, with its stiffness, damping and position.
            measured: Torque from the servo's current [N·m]; NaN: it gives none.
            periods: Periods since the last tick.
        """
        acting = self._acting
        self._ticks += periods
        mean = self._mean + acting.acted(periods) * periods
        self.spanned = periods = self._periods + periods
        self.commanded = commanded = mean / periods
        self.acted = commanded if isnan(measured) else measured
        self._mean = 0.0
        self._periods = 0
        backstop = self.backstop
        backstop.update(
            position - law.position,
            acting.last,
            periods * self._period,
            law.stiffness,
            law.damping + law.injected,
        )
        if backstop.news:
            backstop.news = False
            self._judge()

    def _judge(self) -> None:
        """Set the state, and answer an alarm."""
        backstop, settings = self.backstop, self._settings
        swings = backstop.motions.swings
        early = swings.grows and settings.answer != "reduce" and not settings.passive
        self.alarm = alarm = backstop.alarm or early
        if alarm or backstop.steady:
            last = backstop.motions.half_cycles.last
            grows = len(last) > 1 and last[-1].amplitude > _STILL_GROWS * last[-2].amplitude
            self.current = State.GROWING if alarm and grows else State.SUSTAINED
        else:
            self.current = State.DECAYING if swings.decays else State.QUIET
        if not self.current:
            return
        self._note(self.current)
        if alarm:
            if isnan(self.first_alarm_s):
                self.first_alarm_s = (self._ticks - 1) * self._period
            self.failed = self.failed or backstop.failed or settings.answer == "trip"

    def resume(self) -> None:
        """Restart the watch after a pause without torque; reductions stay."""
        self.backstop.resume()
        self.current = State.QUIET
        self._mean = 0.0
        self._periods = 0

    def change(self, settings: WatchSettings, moved_by: float) -> None:
        """Watch another law from now on; earlier reports stay.

        The backstop goes on: else a law that is changed again and again would never be found to
        oscillate.

        Args:
            settings: Settings of the law.
            moved_by: Way from the position of the law before [rad].
        """
        self._settings = settings
        self.backstop.change(settings, moved_by)

    @property
    def seen(self) -> tuple[float, float]:
        """Return frequency [Hz] and amplitude [rad] now; NaN and 0: no cycle is known."""
        seen = self.backstop.seen
        return (math.nan, 0.0) if seen is None else (1.0 / seen.cycle, seen.amplitude)

    def _note(self, state: State) -> None:
        """Report the worst state, and the largest oscillation on the whole wall.

        A growing and a sustained motion are one oscillation: where it has grown is part of it.
        """
        worse, least = state > self.state, min(self.state, State.SUSTAINED)
        if state < least or (not worse and self.backstop.wall.derating.scale < 1.0):
            return
        frequency_hz, amplitude = self.seen
        if (worse and least < State.SUSTAINED) or amplitude > self.amplitude:
            self.amplitude = amplitude
            self.frequency_hz = frequency_hz
        if worse:
            self.state = state


def oscillation_report(watch: Watch) -> dict[str, object]:
    """Return the observations for the report: None for missing ones."""
    seen = watch.state > State.QUIET
    known = seen and math.isfinite(watch.frequency_hz)
    reduced = watch.backstop.wall.reduced
    return {
        "state": watch.state.name.lower(),
        "frequency_hz": watch.frequency_hz if known else None,
        "amplitude_rad": watch.amplitude if seen else None,
        "first_alarm_s": None if isnan(watch.first_alarm_s) else watch.first_alarm_s,
        "reduced_to": {
            "stiffness": reduced[0],
            "damping": reduced[1],
        },
        "probes": watch.backstop.probes,
        "probed_s": watch.backstop.probed_s,
    }
