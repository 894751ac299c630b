"""Evidence on the source of a motion, the wall or a hand: pure functions, with their thresholds.

The thresholds for hands and probes are measured; docs/evidence/detector-table.md gives the rates
of their errors.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from haptic_wall.controller.detector.half_cycles import Repeated
from haptic_wall.controller.detector.tuning import EvidenceTuning, ProbeTuning


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


def sighting(motion: Repeated, at: float) -> Sighting:
    """Return the motion of the last two half-cycles.

    Args:
        motion: Half-cycles or contacts.
        at: The present time [s].
    """
    return Sighting(
        motion.duration + motion.duration_2,
        0.5 * (motion.amplitude + motion.amplitude_2),
        0.5 * (motion.inertia + motion.inertia_2),
        at,
    )


def lasts(motion: Repeated, tuning: EvidenceTuning) -> bool:
    """Whether the last two half-cycles kept their amplitude over a cycle."""
    return (
        motion.known >= 4
        and motion.amplitude > tuning.kept * motion.amplitude_3
        and motion.amplitude_2 > tuning.kept * motion.amplitude_4
    )


def same_period(motion: Repeated, tuning: EvidenceTuning) -> bool:
    """Whether the last two half-cycles lasted as long as those a cycle before."""
    return (
        motion.known >= 4
        and abs(math.log(motion.duration / motion.duration_3)) < tuning.regular_period
        and abs(math.log(motion.duration_2 / motion.duration_4)) < tuning.regular_period
    )


def saturates(motion: Repeated, limit: float, tuning: EvidenceTuning) -> bool:
    """Whether the last three half-cycles saturated the torque to either side, without decay.

    Args:
        motion: Half-cycles.
        limit: Limit of the torque [N·m].
        tuning: Numbers for evidence.
    """
    return (
        motion.known >= 3
        and min(motion.pull, motion.pull_2, motion.pull_3) > tuning.saturated * limit
        and motion.amplitude > tuning.kept * motion.amplitude_3
        and abs(math.log(motion.duration / motion.duration_3)) < tuning.saturated_period
    )


def is_limit_cycle(motion: Repeated, limit: float, tuning: EvidenceTuning) -> bool:
    """Whether the motion neither grows nor saturates: something other than the limit bounds it.

    Args:
        motion: Half-cycles.
        limit: Limit of the torque [N·m].
        tuning: Numbers for evidence.
    """
    return (
        motion.known >= 4
        and abs(math.log(motion.amplitude / motion.amplitude_3)) < tuning.settled
        and abs(math.log(motion.amplitude_2 / motion.amplitude_4)) < tuning.settled
        and motion.pull < tuning.saturated * limit
    )


def beyond_hands(cycle: float, amplitude: float, pull: float, tuning: EvidenceTuning) -> bool:
    """Whether no hand moves a shaft like this.

    Args:
        cycle: Period [s].
        amplitude: At least a degree or so [rad].
        pull: Torque toward the middle, as that of half-cycles [N·m].
        tuning: Numbers for evidence.
    """
    speed = amplitude * math.tau / cycle
    return (
        cycle * tuning.hands_hz < 1.0
        or speed * math.tau / cycle > tuning.hands_acceleration
        or pull * speed > tuning.hands_power * cycle**3
    )


def explains(inertia: float, before: float, tuning: ProbeTuning) -> bool:
    """Whether the torque of a softer wall explains a motion as well as before.

    Args:
        inertia: Apparent inertia now [kg·m²].
        before: Apparent inertia on the whole wall [kg·m²].
        tuning: Numbers for probes.
    """
    return tuning.lightest * before < inertia < tuning.heaviest * before


class Answer(NamedTuple):
    """The result of a probe, relative to the motion before it."""

    first: float
    """Duration of its first half-cycle, over half the period before [1]"""
    second: float
    """Of its second one [1]"""
    inertia: float
    """Apparent inertia in them, over that before [1]"""
    amplitude: float
    """Amplitude of them, over that before [1]"""


def took_longer(answer: Answer, tuning: ProbeTuning, *, contacts: bool) -> bool:
    """Whether a probe shows that the wall moves the shaft.

    Args:
        answer: Answer to the probe.
        tuning: Numbers for probes.
        contacts: It was of contacts with a one-sided wall.
    """
    first, second, inertia, amplitude = answer
    longest, largest, heaviest = tuning.longest, tuning.largest, tuning.heaviest
    if contacts:
        long = min(first, second) > tuning.contact and first + second > tuning.contacts
        longest, largest = tuning.longest_contact, tuning.deepest_contact
        heaviest = tuning.heaviest_contact
    elif inertia > tuning.explained and amplitude < tuning.grown:
        long = min(first, second) > tuning.explained_each
        long = long and first + second > tuning.explained_both
    else:
        least = tuning.first if amplitude < tuning.grown else tuning.first_grown
        long = first > least and second > tuning.second and first + second > tuning.both
    explained = tuning.lightest < inertia < heaviest
    return long and second < longest and amplitude < largest and explained


def is_clear(answer: Answer, tuning: ProbeTuning, *, contacts: bool) -> bool:
    """Whether a longer answer is as even as a wall makes it; else a second one must confirm it.

    Args:
        answer: Answer to the probe.
        tuning: Bounds that tell answers of walls from those of hands.
        contacts: It was of contacts with a one-sided wall.
    """
    first, second, inertia, amplitude = answer
    shortest, longest = min(first, second), max(first, second)
    if contacts:
        return (
            shortest > tuning.clear_contact
            and longest < tuning.clear_longest_contact
            and tuning.clear_lightest_contact < inertia < tuning.clear_heaviest_contact
            and amplitude < tuning.clear_deepest
        )
    if amplitude < 1.0 and shortest > tuning.clear_smaller and inertia > tuning.clear_explained:
        return True
    return (
        shortest > tuning.clear
        and longest < tuning.clear_longest
        and first + second > tuning.clear_both
        and second < tuning.clear_ratio * first
        and tuning.clear_lightest < inertia < tuning.clear_heaviest
        and amplitude < tuning.clear_largest
    )


def as_unsure(one: Answer, other: Answer, tuning: ProbeTuning) -> bool:
    """Whether two probes have the same answer, which a hand's motion seldom gives twice.

    Args:
        one: An answer that shows no motion by the wall.
        other: That of the probe before.
        tuning: Numbers for probes.
    """
    least, most = tuning.unsure_shortest, tuning.unsure_longest
    light, heavy = tuning.unsure_lightest, tuning.unsure_heaviest
    return (
        all(a.first > tuning.first and least < a.second < most for a in (one, other))
        and all(light < a.inertia < heavy for a in (one, other))
        and abs(math.log(one.second / other.second)) < tuning.unsure_alike
        and abs(one.inertia - other.inertia) < tuning.unsure_alike
    )


def alike(one: Sighting, other: Sighting, tuning: ProbeTuning) -> bool:
    """Whether two motions are one and the same.

    Args:
        one: A motion.
        other: Another one.
        tuning: Largest logarithms of the ratios of their periods and amplitudes.
    """
    return (
        abs(math.log(one.cycle / other.cycle)) < tuning.same_period
        and abs(math.log(one.amplitude / other.amplitude)) < tuning.same_amplitude
    )
