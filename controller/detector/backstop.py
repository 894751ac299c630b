"""Notices a wall that moves the shaft by itself, whatever the servo is, and makes it softer.

A motion that does not die may be fed by the wall, or made by a hand. The motion alone does not say
which: a change of the wall does. So the wall is probed: at a turning point elastic torque, the
limit of that torque, and damping all go down to a quarter. What the wall moves then takes longer:
twice as long for a linear spring. What a hand moves takes as long as before. Nothing that is
believed of the servo enters the answer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from controller.detector.half_cycles import Repeated, lasts, same_period
from controller.detector.steady import Steadiness

PROBED, PROBED_COUNTS, SMALL_COUNTS = 0.01745, 10.0, 3.0
"""Amplitude from which undying motion is probed: 1° [rad], or in counts of the encoder; and from
which steady motion is, in counts [1]"""
PROBE = 0.25
"""Scale of elastic torque, its limit and damping in a probe [1]"""
KEPT = 0.98
"""A motion that does not die keeps this fraction of its amplitude over a cycle."""
STEADY = 40
"""Half-cycles in a row that no hand makes so evenly"""
_SAME_PERIOD = 0.12
"""Largest logarithm of the ratio of durations in a regular motion"""
_SATURATED, _SATURATED_PERIOD = 0.55, 0.3
"""Fraction of the torque limit that is the mean pull of a saturated motion, and its tolerance:
such a motion lengthens while it grows"""
_FASTER_THAN_HANDS_HZ, _SHARPER_THAN_HANDS = 15.0, 700.0
"""No hand moves a shaft to and fro by a degree as fast as this, nor turns it around with such an
acceleration [rad/s²]: 0.5 rad to either side at 6 Hz, 0.1 rad at 13 Hz"""
_FIRST, _SECOND, _BOTH = 1.05, 1.40, 2.6
"""The wall moves the shaft if the first and the second half-cycle of a probe, and their sum, are
longer than this; relative to the half-cycles before"""
_CONTACT, _CONTACTS = 1.6, 1.75
"""The same of the two contacts of a probe: least ratio of each, and of their mean. A hand's contact
lasts longer at a softer wall too, but not that much."""
_LONGEST = 3.2
"""A half-cycle in which the motion has changed altogether"""
_APPARENT = (0.5, 1.3)
"""Range of the apparent inertia in a probe over that before, if the torque still explains the
motion. What a hand moves seems lighter by the scale of the probe."""
_LEAST_GAIN = -0.05
"""Contacts left slower than they were entered, as logarithm of the speeds, die by themselves."""
_CYCLES_EVEN = 2
"""Ends of half-cycles in a row at which the motion is regular before it is probed"""
_UNLIKELY = 10
"""Regular half-cycles after which a motion is probed though the servo cannot be so light or heavy
"""
_HOLD_OFF_S = 10.0
"""Time for which a motion like the one that a hand made is not probed again"""
_OTHER_PERIOD, _OTHER_AMPLITUDE = 0.25, 1.6
"""Logarithm of the ratio of periods, and growth, from which a motion is not like it"""
_FADES_HZ, _FADE_SIZE = 8.0, 2.5
"""Slower motions whose period stays are hands, and smaller ones than so many thresholds may be
tremor; others may be a load that swings on its transmission."""
_FADE_EACH, _FADE_ALL, _FADE_LONGEST = 0.985, 0.75, 8
"""Such a motion fades by this ratio in each half-cycle, and in all, within so many half-cycles."""
_COLLAPSED = 0.6
"""Ratio of amplitudes below which a motion has stopped in the probe"""
_STOPPED = 3.0
"""The same, in times between turning points, without another one"""
_AGAIN_S, _AGAIN_PERIOD, _AGAIN_AMPLITUDE = 5.0, 0.1, 0.5
"""A motion that stopped in a probe and is back within this time, as fast and as large but for these
logarithms, is the wall's."""
_DYING = 0.95
"""Ratio of amplitudes over a cycle in a motion that dies"""
_AS_BEFORE = 0.85, 1.25, 1.6
"""Range of the period over that before the alarm in which the alarm was wrong; the upper end for
the first step, and for later ones"""
_OWN = 1.3, 2.0, 3.0
"""Ratio of the period to that before the alarm that leaves no doubt, step by step; a linear spring
makes it 2, 4 and 8"""
_GOES_ON = 6
"""Half-cycles of undying motion on the softest wall that are a hand's"""
_STEPS = 3
"""Steps of the reduction: a quarter, a sixteenth, a sixty-fourth"""
_SETTLED, _BACKLASH = 0.05, 4.0
"""Largest logarithm of the change of an amplitude over a cycle in a limit cycle; and largest
amplitude of one that backlash is blamed for, in thresholds"""
_LEAST_STEPS = 2.0
"""Encoder counts within which the spring is at rest however stiff it is [1]"""
CYCLES, LONGEST_S = 6.0, 5.0
"""Time within which a motion must die: cycles of the slowest motion, and at most this long [s]"""
_HURRY = 0.9
"""Fraction of that time after which a motion that does not die ends the run"""


class Phase(IntEnum):
    """What the backstop does."""

    WATCHING = 0
    PROBING = 1
    REDUCED = 2
    RETURNING = 3
    """The wall comes back as soon as its spring is at rest."""


class Cause(IntEnum):
    """Why the wall was reduced."""

    LONGER = 0
    """A half-cycle took longer in the probe."""
    STOPPED = 1
    """The motion stopped in the probe, and somebody suspected the wall, or it came again."""
    BEYOND_HANDS = 2
    """No hand moves a shaft so fast, so sharply, or so evenly."""


@dataclass(frozen=True, slots=True)
class BackstopSettings:
    """When the backstop looks, and what it may do."""

    period: float
    """T [s]"""
    position_step: float
    """Encoder count [rad]; 0: none"""
    threshold: float
    """Amplitude from which a motion is probed [rad]"""
    small: float
    """Amplitude from which a steady motion is [rad]"""
    light: float
    """Least apparent inertia the servo may have, torque as commanded [kg·m²]. With ``heavy`` it
    only decides how soon a motion is probed."""
    heavy: float
    """Largest one [kg·m²]"""
    heaviest: float
    """Largest inertia that is believed, likewise: the slowest motion that K allows [kg·m²]"""
    rest_torque: float
    """The wall comes back where the difference of the elastic torques is less [N·m]."""
    torque_limit: float
    """[N·m]"""
    acts: bool = True
    """It may change the wall; else it only tells."""
    bounces: bool = False
    """It watches contacts, not half-cycles."""


class Backstop:
    """Sees what repeats, probes the wall, reduces it, and gives up.

    Attributes:
        phase: What it does.
        stiffness_scale: Of the elastic torque and of its limit [1].
        damping_scale: Of the damping [1].
        alarm: The wall feeds the motion.
        steady: The motion repeats as evenly as no hand's.
        failed: Reducing does not help: the run must end.
        moved: Probes that found a hand.
        probes: All probes.
        reductions: Alarms.
        returned: Alarms that were found wrong; what they took was given back.
        suspected: Somebody else has reduced the wall, and wants to know whether the wall moves the
            shaft: the next motion is probed. May be set at any time.
        small_cycle: The last alarm was about a steady motion below the threshold.
        backlash: The last alarm was about a motion of a few degrees at most that neither grew nor
            saturated the torque: a limit cycle of backlash, most likely.
    """

    __slots__ = (
        "_begun",
        "_cause",
        "_count",
        "_cycle",
        "_fading",
        "_first",
        "_motion",
        "_moved_amplitude",
        "_moved_cycle",
        "_moved_s",
        "_seems",
        "_settings",
        "_settled",
        "_since",
        "_size",
        "_steadiness",
        "_step",
        "_stiffness",
        "_stopped_amplitude",
        "_stopped_cycle",
        "_stopped_s",
        "_streak",
        "_time",
        "alarm",
        "backlash",
        "damping_scale",
        "failed",
        "moved",
        "phase",
        "probes",
        "reductions",
        "returned",
        "small_cycle",
        "steady",
        "stiffness_scale",
        "suspected",
    )

    def __init__(self, settings: BackstopSettings, motion: Repeated) -> None:
        """Begin to watch.

        Args:
            settings: When it looks, and what it may do.
            motion: What has been seen of the motion; whoever updates it says so to ``ended``.
        """
        self._settings = settings
        self._motion = motion
        self._steadiness = Steadiness(settings.period, settings.position_step)
        self._time = self._since = self._begun = 0.0
        self._stiffness = 0.0
        self._streak = self._count = self._step = 0
        self._cycle = self._size = self._seems = self._first = self._fading = 0.0
        self._cause = Cause.STOPPED
        self._moved_s = self._stopped_s = -math.inf
        self._moved_cycle = self._moved_amplitude = 1.0
        self._stopped_cycle = self._stopped_amplitude = 1.0
        self.phase = Phase.WATCHING
        self.stiffness_scale = self.damping_scale = 1.0
        self.alarm = self.steady = self.failed = self.small_cycle = self.backlash = False
        self._settled = False
        self.suspected = False
        self.moved = self.probes = self.reductions = self.returned = 0

    @property
    def large(self) -> bool:
        """Whether the last two half-cycles were above the threshold."""
        motion = self._motion
        return min(motion.amplitude, motion.amplitude_2) >= self._settings.threshold

    def passed(self, span: float, elongation: float, stiffness: float) -> None:
        """Let time pass; to be called once a sample, before ``ended``.

        Args:
            span: Since the sample before [s].
            elongation: Of the wall's spring, either sign [rad].
            stiffness: K without this object's scale [N·m/rad].
        """
        self._time += span
        self._stiffness = stiffness
        phase = self.phase
        if phase == Phase.WATCHING:
            return
        if phase == Phase.PROBING:
            motion = self._motion
            if motion.elapsed > _STOPPED * max(motion.interval, 0.5 * self._cycle):
                self._stopped()
        elif phase == Phase.RETURNING:
            missing = (1.0 - self.stiffness_scale) * stiffness * elongation
            least = _LEAST_STEPS * self._settings.position_step
            if abs(missing) <= self._settings.rest_torque or abs(elongation) <= least:
                self.stiffness_scale = self.damping_scale = 1.0
                self.phase = Phase.WATCHING
        elif self.alarm and self._motion.elapsed > _STOPPED * self._motion.interval:
            self.alarm = False  # the reduced wall is at rest

    def raise_again(self) -> None:
        """Give back what was taken, as soon as the spring is at rest, and begin to watch anew."""
        self.phase = Phase.RETURNING
        self.alarm = self.small_cycle = self.suspected = False
        self._stopped_s = self._moved_s = -math.inf
        self._streak = 0

    def resume(self) -> None:
        """Begin to watch anew after a pause; what an alarm took stays taken."""
        self._streak = self._count = 0
        self.alarm = False
        if self.phase == Phase.PROBING:
            self.phase = Phase.RETURNING

    def ended(self) -> None:
        """Take notice that a half-cycle, or a contact, has ended."""
        motion, settings = self._motion, self._settings
        self._count += 1
        size = min(motion.amplitude, motion.amplitude_2)
        self._steadiness.take(motion)
        self.steady = self._steadiness.count >= STEADY and size >= settings.small
        undying = lasts(motion, KEPT)
        even = undying and same_period(motion, _SAME_PERIOD)
        self._streak = self._streak + 1 if even else 0
        if not self._streak:
            self._since = self._time - motion.duration - motion.duration_2
        if self.phase == Phase.WATCHING:
            if size < settings.threshold:
                regular = self.steady
            else:
                before = min(motion.amplitude_3, motion.amplitude_4)
                even = self._streak >= _CYCLES_EVEN and before >= settings.threshold
                regular = even or self._saturated()
            regular = regular and motion.gain > _LEAST_GAIN
            if regular or (self.suspected and size >= settings.threshold and motion.known >= 2):
                self._consider()
            else:
                self.alarm = False
        elif self.phase == Phase.PROBING:
            self._answer()
        elif self.phase == Phase.REDUCED:
            self._judge(undying)

    def _saturated(self) -> bool:
        """Whether the last three saturated the torque to either side, and did not die."""
        motion = self._motion
        return (
            motion.known >= 3
            and min(motion.pull, motion.pull_2, motion.pull_3)
            > _SATURATED * self.stiffness_scale * self._settings.torque_limit
            and motion.amplitude > KEPT * motion.amplitude_3
            and abs(math.log(motion.duration / motion.duration_3)) < _SATURATED_PERIOD
        )

    def _consider(self) -> None:
        """Decide what a regular motion that does not die is answered with."""
        motion, settings = self._motion, self._settings
        self._begun = self._since
        self._settled = (
            motion.known >= 4
            and abs(math.log(motion.amplitude / motion.amplitude_3)) < _SETTLED
            and abs(math.log(motion.amplitude_2 / motion.amplitude_4)) < _SETTLED
            and motion.pull < _SATURATED * settings.torque_limit
        )
        self._cycle = cycle = motion.duration + motion.duration_2
        self._size = size = 0.5 * (motion.amplitude + motion.amplitude_2)
        self._seems = seems = 0.5 * (motion.inertia + motion.inertia_2)
        if self._beyond_hands(cycle, size):
            self._alarm(Cause.BEYOND_HANDS)
            return
        if not settings.acts:
            return
        if self.suspected:
            self._probe()
            return
        alike = (
            abs(math.log(cycle / self._moved_cycle)) < _OTHER_PERIOD
            and size < _OTHER_AMPLITUDE * self._moved_amplitude
        )
        if alike and self._time - self._moved_s < _HOLD_OFF_S:
            if self.steady and size >= settings.threshold:
                self._alarm(Cause.BEYOND_HANDS)  # a probe found a hand, but none is so even
            return
        if self.steady or self._streak >= _UNLIKELY or settings.light < seems < settings.heavy:
            self._probe()

    def _beyond_hands(self, cycle: float, amplitude: float) -> bool:
        """Whether no hand moves a shaft like this: a period [s] and an amplitude [rad]."""
        return not self._settings.bounces and (
            cycle * _FASTER_THAN_HANDS_HZ < 1.0
            or amplitude * (math.tau / cycle) ** 2 > _SHARPER_THAN_HANDS
        )

    def _probe(self) -> None:
        self.phase = Phase.PROBING
        self.probes += 1
        self._count = 0
        self.stiffness_scale = self.damping_scale = PROBE

    def _answer(self) -> None:
        """Judge a probe when a half-cycle of it has ended."""
        motion = self._motion
        ratio = 2.0 * motion.duration / self._cycle
        size = 0.5 * (motion.amplitude + motion.amplitude_2)
        if self._count == 1:
            self._first = ratio
        elif self._count == 2:
            if self._longer_now(ratio):
                self._alarm(Cause.LONGER)
            elif size < _COLLAPSED * self._size:
                self._stopped()
            elif self._may_fade():
                self._fading = size
            else:
                self._somebody_moves_it()
        elif size < _FADE_ALL * self._fading:
            self._stopped()
        elif motion.amplitude > _FADE_EACH * motion.amplitude_2 or self._count > _FADE_LONGEST:
            self._somebody_moves_it()

    def _may_fade(self) -> bool:
        """Whether a probed motion whose period stays may be a load on its transmission."""
        settings = self._settings
        return (
            not settings.bounces
            and self._cycle * _FADES_HZ < 1.0
            and self._size > _FADE_SIZE * settings.threshold
        )

    def _longer_now(self, ratio: float) -> bool:
        """Whether the two of the probe took longer, and the torque still explains them."""
        motion = self._motion
        least, most = _APPARENT
        seems = 0.5 * (motion.inertia + motion.inertia_2) / self._seems
        each, both = (_CONTACT, 2.0 * _CONTACTS) if self._settings.bounces else (_SECOND, _BOTH)
        return (
            self._first > (each if self._settings.bounces else _FIRST)
            and each < ratio < _LONGEST
            and self._first + ratio > both
            and least < seems < most
        )

    def _stopped(self) -> None:
        """Take notice that the motion has stopped in the probe.

        It was the wall's if somebody suspected that, or if it comes again and stops again.
        """
        again = (
            self._time - self._stopped_s < _AGAIN_S
            and abs(math.log(self._cycle / self._stopped_cycle)) < _AGAIN_PERIOD
            and abs(math.log(self._size / self._stopped_amplitude)) < _AGAIN_AMPLITUDE
        )
        if again or self.suspected:
            self._alarm(Cause.STOPPED)
            return
        self._stopped_s = self._time
        self._stopped_cycle, self._stopped_amplitude = self._cycle, self._size
        self.phase = Phase.RETURNING

    def _alarm(self, cause: Cause) -> None:
        """Reduce the wall; damping stays where the probe took longer: the spring is to blame."""
        self.reductions += not self.alarm
        self.alarm = True
        self.suspected = False
        self.small_cycle = self._size < self._settings.threshold
        self.backlash = self._settled and self._size < _BACKLASH * self._settings.threshold
        if not self._settings.acts:
            return
        self._cause = cause
        self.phase = Phase.REDUCED
        self._step, self._count = 1, 0
        self.stiffness_scale = PROBE
        self.damping_scale = 1.0 if cause == Cause.LONGER else PROBE

    def _judge(self, undying: bool) -> None:
        """Go on reducing a motion that does not die; give the wall back if a hand makes it."""
        motion, settings = self._motion, self._settings
        size = min(motion.amplitude, motion.amplitude_2)
        if size < (settings.small if self.small_cycle else settings.threshold):
            self.alarm = False
            return
        if self._count < 2:
            return
        shrinks = motion.amplitude < _DYING * motion.amplitude_3
        if shrinks and motion.amplitude_2 <= motion.amplitude_4:
            self.alarm = False
            return
        if self.small_cycle and not (undying and self._count >= STEADY):
            return
        self.alarm = True
        cycle = motion.duration + motion.duration_2
        if self._hand_after_all(cycle / self._cycle):
            self._was_wrong()
        elif size >= settings.threshold and self._own(cycle) and self._is_last():
            self.failed = True
        elif self._step >= _STEPS:
            if self._count >= _GOES_ON and not self.small_cycle:
                self._was_wrong()
        else:
            self.damping_scale = PROBE**self._step
            self._step += 1
            self.stiffness_scale = PROBE**self._step
            self._count = 0

    def _hand_after_all(self, ratio: float) -> bool:
        """Whether the reduced wall is moved as fast as before, which only a hand does.

        Args:
            ratio: Of the period to that before the alarm.
        """
        least, most, later = _AS_BEFORE
        if self._cause == Cause.LONGER:
            return least < ratio < (most if self._step == 1 else later)
        return (
            self._cause == Cause.STOPPED
            and not self.steady
            and self._streak >= _CYCLES_EVEN
            and least < ratio < most
        )

    def _own(self, cycle: float) -> bool:
        """Whether there is no doubt that the wall makes this motion.

        Args:
            cycle: Its period [s].
        """
        if self._cause == Cause.LONGER:
            return self._streak > 0 and cycle / self._cycle > _OWN[self._step - 1]
        return self._cause == Cause.BEYOND_HANDS or self.steady

    def _is_last(self) -> bool:
        """Whether there is nothing left to reduce, or no time."""
        return self._step >= _STEPS or (not self._settings.bounces and self._late())

    def _late(self) -> bool:
        """Whether the time within which the motion must die is running out."""
        stiffness = self._stiffness
        cycle = math.tau * math.sqrt(self._settings.heaviest / stiffness) if stiffness > 0 else 1e9
        return self._time - self._begun > _HURRY * min(CYCLES * cycle, LONGEST_S)

    def _was_wrong(self) -> None:
        """Take the alarm back."""
        self.alarm = self.small_cycle = self.backlash = False
        self.returned += 1
        self._somebody_moves_it()

    def _somebody_moves_it(self) -> None:
        """Give the wall back, and leave this motion alone for a while."""
        self.moved += 1
        self.suspected = False
        self._moved_s = self._time
        self._moved_cycle, self._moved_amplitude = self._cycle, self._size
        self.phase = Phase.RETURNING
