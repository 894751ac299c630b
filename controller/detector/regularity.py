"""Judges a motion by its half-cycles: regular, saturated, steady, beyond hands, the servo's own."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from haptic_wall.controller.detector.contacts import Contacts
from haptic_wall.controller.detector.half_cycles import HalfCycle, HalfCycles
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.tuning import TUNING

_SIZES = 25
"""Amplitudes over which growth and decay are looked for"""
_DECAYS = 0.01
"""A motion decays if the logarithm of its amplitude has fallen by this over them [1]."""


class Sighting(NamedTuple):
    """A motion at one time."""

    cycle: float
    """Its period [s]"""
    amplitude: float
    """[rad]"""
    inertia: float
    """Apparent [kg·m²]"""
    at: float
    """[s]"""


NEVER = Sighting(1.0, 1.0, 1.0, -math.inf)


def sighting(last: deque[HalfCycle], at: float) -> Sighting:
    """Return the motion of the last two half-cycles.

    Args:
        last: Half-cycles or contacts.
        at: The present time [s].
    """
    new, old = last[-1], last[max(-2, -len(last))]
    return Sighting(
        new.duration + old.duration,
        0.5 * (new.amplitude + old.amplitude),
        0.5 * (new.inertia + old.inertia),
        at,
    )


def apart(one: float, other: float) -> float:
    """Return the absolute logarithm of the ratio of two positive values."""
    return abs(math.log(one / other))


def lasts(last: deque[HalfCycle]) -> bool:
    """Whether the last two half-cycles kept their amplitude over a cycle."""
    return (
        len(last) == 4
        and last[3].amplitude > TUNING.kept * last[1].amplitude
        and last[2].amplitude > TUNING.kept * last[0].amplitude
    )


def same_period(last: deque[HalfCycle]) -> bool:
    """Whether the last two half-cycles lasted as long as those a cycle before."""
    return (
        len(last) == 4
        and apart(last[3].duration, last[1].duration) < TUNING.regular_period
        and apart(last[2].duration, last[0].duration) < TUNING.regular_period
    )


def saturates(last: deque[HalfCycle], limit: float) -> bool:
    """Whether the last three half-cycles saturated the torque to either side, without decay.

    One that grows takes longer, with the root of its amplitude; its apparent inertia stays.

    Args:
        last: Half-cycles.
        limit: Limit of the torque [N·m].
    """
    if len(last) < 3:
        return False
    new, old = last[-1], last[-3]
    return (
        min(new.pull, last[-2].pull, old.pull) > TUNING.saturated * limit
        and new.amplitude > TUNING.kept * old.amplitude
        and apart(new.inertia, old.inertia) < TUNING.saturated_inertia
    )


def beyond_hands(last: deque[HalfCycle]) -> bool:
    """Whether no hand moves a shaft like the last two half-cycles, of a degree or so at least."""
    if len(last) < 3:
        return False
    cycle = last[-1].duration + last[-2].duration
    speed = 0.5 * (last[-1].amplitude + last[-2].amplitude) * math.tau / cycle
    pull = min(last[-1].pull, last[-2].pull, last[-3].pull)
    return (
        cycle * TUNING.hands_hz < 1.0
        or speed * math.tau / cycle > TUNING.hands_acceleration
        or pull * speed > TUNING.hands_power * cycle**3
    )


class Regularity:
    """Follows a motion, half-cycle by half-cycle or contact by contact.

    Attributes:
        motion: The motion.
        contacts: It consists of contacts.
        streak: Number of half-cycles in a row that neither decay nor change their period.
        since: When the streak began [s].
        steady: The motion is more regular than a hand's.
        decays: The believed servo makes it, and it becomes smaller.
        grows: The believed servo makes it, and it becomes larger, evenly.
    """

    def __init__(self, motion: HalfCycles | Contacts, settings: WatchSettings) -> None:
        """Start without a motion."""
        self.motion, self.contacts = motion, isinstance(motion, Contacts)
        self._settings = settings
        self._streak_sizes: deque[float] = deque(maxlen=TUNING.loss_half_cycles + 2)
        self._sizes: deque[float] = deque(maxlen=_SIZES)
        self._long: deque[HalfCycle] = deque(maxlen=TUNING.goes_on)
        self._first: list[HalfCycle | None] = [None, None]
        self._way = self._even = self.streak = 0
        self.since = 0.0
        self.steady = self.decays = self.grows = False

    def forget(self) -> None:
        """Discard what was seen; ``since`` stays."""
        self.motion.last.clear()
        self._sizes.clear()
        self._long.clear()
        self.streak = self._even = 0
        self.steady = self.decays = self.grows = False

    def take(self, at: float) -> None:
        """Judge the motion, whose last half-cycle has just ended; ``at``: the time now [s]."""
        last, settings = self.motion.last, self._settings
        new = last[-1]
        self._count_even(new)
        enough = self._even >= TUNING.steady and self.size >= settings.small
        self.steady = enough and self.pulled
        regular = same_period(last)
        self.streak = self.streak + 1 if regular and lasts(last) else 0
        self._long.append(new)
        self._streak_sizes.append(new.amplitude)
        while not regular and len(self._streak_sizes) > 4:
            self._streak_sizes.popleft()
        if not self.streak:
            self.since = at - new.duration - (last[-2].duration if len(last) > 1 else 0.0)
        self._judge_own(new)

    @property
    def size(self) -> float:
        """Return the smaller amplitude of the last two half-cycles [rad]; 0: there are fewer."""
        last = self.motion.last
        return min(last[-1].amplitude, last[-2].amplitude) if len(last) > 1 else 0.0

    @property
    def pulled(self) -> bool:
        """Whether the wall had a part in the last half-cycles; not in a law's free range."""
        return any(one.pull > 0.0 for one in self.motion.last)

    @property
    def suspect(self) -> bool:
        """Whether it does not decay, and is regular, saturates the torque, or is too fast."""
        settings, suspect = self._settings, self.steady
        if self.size >= settings.threshold:
            full = saturates(self.motion.last, settings.torque_limit)
            suspect = self.repeats or full or self.races
        return suspect and self.motion.gain > TUNING.least_gain

    @property
    def repeats(self) -> bool:
        """Whether the motion is regular above the threshold, and does not die by itself."""
        last, sizes = self.motion.last, self._streak_sizes
        least, threshold = min(one.amplitude for one in last), self._settings.threshold
        enough = TUNING.regular if least > 2.0 * threshold else TUNING.loss_half_cycles
        if self.streak < enough or least < threshold or not self.pulled:
            return False
        before, now = 0.5 * (sizes[0] + sizes[1]), 0.5 * (sizes[-1] + sizes[-2])
        cycles = 0.5 * (len(sizes) - 2)
        rounding = TUNING.loss_counts * self._settings.position_step
        return before - now <= max(rounding, TUNING.loss * cycles * now)

    def goes_on(self, least: float) -> bool:
        """Whether its half-cycles have become no smaller for long, regular or not.

        Args:
            least: Smallest amplitude that counts [rad].
        """
        if self.contacts or len(self._long) < TUNING.goes_on or self.size < least:
            return False
        half, every = TUNING.goes_on // 2, list(self._long)
        before, now = (sum(one.amplitude for one in part) for part in (every[:half], every[half:]))
        return now > TUNING.kept * before

    @property
    def races(self) -> bool:
        """Whether it goes on, and none of its half-cycles is as long as a hand's."""
        longest = 0.5 / TUNING.hands_hz
        every = all(one.duration < longest for one in self._long)
        return every and self.goes_on(self._settings.threshold)

    def beats(self, stiffness: float) -> bool:
        """Whether several motions together saturate the torque far, and do not become smaller.

        Args:
            stiffness: K [N·m/rad].
        """
        if not self.goes_on(self._settings.threshold):
            return False
        limit = self._settings.torque_limit * len(self._long)
        far = stiffness * sum(abs(one.end) for one in self._long) > TUNING.beating_far * limit
        return far and sum(one.pull for one in self._long) > TUNING.beating_pull * limit

    @property
    def nearly_steady(self) -> bool:
        """Whether it has been steady for half of what no hand is: a probe would disturb it."""
        return not self.steady and 2 * self._even > TUNING.steady

    def _count_even(self, new: HalfCycle) -> None:
        """Count a half-cycle like the first one in its direction; else restart the count."""
        self._way ^= 1
        first, settings = self._first[self._way], self._settings
        if self._even > 1 and first is not None:
            amplitude = max(
                TUNING.steady_amplitude * first.amplitude,
                TUNING.steady_counts * settings.position_step,
            )
            duration = max(
                TUNING.steady_duration * first.duration, TUNING.steady_periods * settings.period
            )
            if (
                abs(new.amplitude - first.amplitude) <= amplitude
                and abs(new.duration - first.duration) <= duration
            ):
                self._even += 1
                return
            self._even = 0
        self._first[self._way] = new
        self._even += 1

    def _judge_own(self, new: HalfCycle) -> None:
        """Judge whether the believed servo alone makes the motion, and how that changes."""
        settings, sizes = self._settings, self._sizes
        low, high = TUNING.lightest * settings.light, TUNING.heaviest * settings.heavy
        if self.contacts or not low < new.inertia < high:
            sizes.clear()
            self.decays = self.grows = False
            return
        sizes.append(math.log(new.amplitude))
        self.decays = len(sizes) > 2 and sizes[-1] < sizes[max(-9, -len(sizes))] - _DECAYS
        self.grows = self._grows()

    def _grows(self) -> bool:
        """Whether the amplitudes grow evenly by enough, or have stayed for as long as is known."""
        sizes = list(self._sizes)
        step, first, grown, least = self._settings.position_step, 0.0, 0.0, math.inf
        for count in range(1, len(sizes)):
            first = sizes[-count - 1]
            grown, rounding = sizes[-1] - first, step * math.exp(-first)
            least = min(least, sizes[-count] - first + rounding)
            enough = count >= TUNING.grows_half_cycles and grown > TUNING.grows
            evenly = least > TUNING.grows_evenly * grown / count
            if enough and evenly and TUNING.grows_counts * rounding < 1.0:
                return True
        if self._settings.acts or len(sizes) < _SIZES:
            return False  # a probe tells more
        return grown >= 0.0 and least > -_DECAYS and math.exp(first) >= self._settings.threshold
