"""Watches the running wall for an oscillation of its own making, and answers it.

``report`` only tells. ``reduce`` takes stiffness and damping together toward the origin, a step
each half cycle until the motion decays: along that ray a stable wall stays stable. They come back
only on request. A step is timed to act where the motion turns, unless waiting costs more: there the
spring holds all the energy, and a softer one keeps less of it, while in the middle the motion holds
it and would swing further against a softer spring. Where all that does not help, and in ``trip``,
the run ends. The torque itself is never limited in its rate: that would be one more delay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from controller.acting import ActingTorque
from controller.oscillation import Detector, DetectorSettings, State

Answer = Literal["report", "reduce", "trip"]

LEAST_SHARE = 1.0 / 64.0
"""Of the decision's stiffness. What still oscillates at less is not the wall's doing."""
_STEP = 0.5
"""What a step leaves where the servo's friction is not known."""
_MARGIN = 0.8
"""Share of the stiffness thought neutral that a step leaves; and the most it leaves."""
_LARGEST_STEP = 0.25
"""The least it leaves: the motion swings further against a spring that is softer still."""
_NEAR = 0.02
"""So near to the best moment is as good [1]"""
_LONGEST_S = 0.5
"""A step is waited for at most so long, however slow the oscillation [s]."""


@dataclass(frozen=True, slots=True)
class WatchSettings:
    """What the watch knows, and what it is to do."""

    detector: DetectorSettings
    answer: Answer
    lag: float
    """From a torque's being sent to its action, believed [s]"""
    inserted: float = 0.0
    """From a torque's being computed to its being sent [s]"""


class Watch:
    """The detector on the torque that acts, and what is done about an alarm.

    Attributes:
        share: Of the guard's stiffness and damping that may be commanded [1].
        failed: The run must end: the answer is ``trip``, or reducing has not helped.
        state: The worst seen.
        frequency_hz: Of the largest oscillation in that state, before the wall was reduced [Hz];
            NaN: none was seen.
        amplitude: Of it [rad].
        first_alarm_s: When the first alarm came, from when the wall went on [s]; NaN: none has.
        current: What the motion does now.
        acted: Mean torque that acted between the last two samples [N·m].
        spanned: Periods between them.
    """

    __slots__ = (
        "_acting",
        "_detector",
        "_last_move",
        "_mean",
        "_period",
        "_periods",
        "_position",
        "_settings",
        "_since_turn",
        "_ticks",
        "_wait",
        "acted",
        "amplitude",
        "current",
        "failed",
        "first_alarm_s",
        "frequency_hz",
        "share",
        "spanned",
        "state",
    )

    def __init__(self, settings: WatchSettings) -> None:
        self._settings = settings
        self._period = settings.detector.period
        self._detector = Detector(settings.detector)
        self._acting = ActingTorque(0.0)
        self._mean = 0.0
        self._periods = 0
        self._ticks = 0
        self._wait = 0
        self._position = math.nan
        self._last_move = 0.0
        self._since_turn = 0
        self.acted = 0.0
        self.spanned = 1
        self.share = 1.0
        self.failed = False
        self.current = self.state = State.QUIET
        self.frequency_hz = math.nan
        self.amplitude = 0.0
        self.first_alarm_s = math.nan

    def set_age(self, age_s: float) -> None:
        """Say how old a sample is when its torque is sent [s]."""
        self._acting.lag = (age_s + self._settings.lag) / self._period

    def passed(self, periods: int) -> None:
        """A tick has come, ``periods`` after the one before."""
        self._mean += self._acting.acted(periods) * periods
        self._periods += periods
        self._ticks += periods

    def sent(self, torque: float) -> None:
        """Keep the torque that the tick has sent [N·m]."""
        self._acting.send(torque)

    def sample(self, position: float, stiffness: float, measured: float) -> None:
        """Take a new position, in the tick that ``passed`` has told of.

        Args:
            position: [rad]
            stiffness: Commanded [N·m/rad].
            measured: Torque from the servo's current [N·m]; NaN: it gives none.
        """
        self.spanned = periods = self._periods
        torque = self._mean / periods
        if not math.isnan(measured):
            torque = measured
        self.acted = torque
        self._mean = 0.0
        self._periods = 0
        detector = self._detector
        detector.stiffness = stiffness
        self.current = state = detector.update(position, torque, periods)
        if state:
            self._note(state)
        self._follow(position, periods)
        if detector.alarm:
            if math.isnan(self.first_alarm_s):
                self.first_alarm_s = self._ticks * self._period
            self._answer()

    def raise_again(self) -> None:
        """Allow all that the guard allows again, and begin to watch anew."""
        self.share = 1.0
        self._wait = 0
        self._detector.restart()

    def _note(self, state: State) -> None:
        amplitude = self._detector.amplitude
        larger = amplitude > self.amplitude and self.share == 1.0
        if state > self.state or (state == self.state and larger):
            self.state = state
            self.amplitude = amplitude
            self.frequency_hz = self._detector.frequency_hz

    def _follow(self, position: float, periods: int) -> None:
        """Know when the motion last went another way than before."""
        moved = position - self._position
        self._position = position
        self._since_turn += periods
        if moved:
            if moved * self._last_move < 0.0:
                self._since_turn = 0
            self._last_move = moved

    def _answer(self) -> None:
        answer = self._settings.answer
        if answer == "trip":
            self.failed = True
        if answer != "reduce" or self._ticks < self._wait:
            return
        if self.share <= LEAST_SHARE:
            self.failed = True
            return
        detector = self._detector
        hertz = detector.frequency_hz
        step = self._step(detector.growth, hertz, detector.amplitude)
        if not self._better_now(step, detector.growth, hertz):
            return
        self.share = max(LEAST_SHARE, self.share * step)
        # On the softer spring half a cycle is longer.
        half_s = 0.5 / (hertz * math.sqrt(step)) if hertz > 0.0 else _LONGEST_S
        self._wait = self._ticks + math.ceil(min(half_s, _LONGEST_S) / self._period)

    def _step(self, growth: float, hertz: float, amplitude: float) -> float:
        """Share of the stiffness that is left after a step.

        An oscillation that grows at s has ``K (T/2 + t_d) - B - b = 2 m s``: the wall gives that
        much more than the servo's own damping takes, Coulomb friction's ``4 c / (pi A w)`` with
        it. The wall's part goes with the share: ``b / (b + 2 m s)`` of it would be neutral.

        Source: Gil et al., ICRA 2007, eq. (8), with the growth of m x'' + c x' + K x = 0.
        """
        known = self._settings.detector
        if not (growth > 0.0 and hertz > 0.0 and known.damping > 0.0 and known.inertia > 0.0):
            return _STEP
        damping = known.damping
        if known.coulomb > 0.0 and amplitude > 0.0:
            damping += 2.0 * known.coulomb / (math.pi**2 * amplitude * hertz)
        neutral = damping / (damping + 2.0 * known.inertia * growth)
        return min(max(_MARGIN * neutral, _LARGEST_STEP), _MARGIN)

    def _better_now(self, step: float, growth: float, hertz: float) -> bool:
        """Whether a step leaves less motion when it is taken now than at the next turn.

        It acts a delay later. At an angle past the turn a part sin² of the energy is in the
        motion, and swings further against the softer spring; while one waits, the motion grows.
        """
        if not hertz > 0.0:
            return True
        half = 0.5 / (hertz * self._period)
        delay = self._acting.lag + self._settings.inserted / self._period
        past = (self._since_turn + delay) % half
        angle = math.pi * past / half
        now = math.sqrt(math.cos(angle) ** 2 + math.sin(angle) ** 2 / step)
        rate = growth * self._period if growth > 0.0 else 0.0
        return now <= math.exp(min(rate * (half - past), 50.0)) + _NEAR


def oscillation_report(watch: Watch) -> dict[str, object]:
    """What was seen, for the report: None for what there was not."""
    seen = watch.state > State.QUIET
    alarmed = not math.isnan(watch.first_alarm_s)
    known = seen and math.isfinite(watch.frequency_hz)
    return {
        "state": watch.state.name.lower(),
        "frequency_hz": watch.frequency_hz if known else None,
        "amplitude_rad": watch.amplitude if seen else None,
        "first_alarm_s": watch.first_alarm_s if alarmed else None,
        "reduced_to": watch.share,
    }
