"""Evidence on the source of a motion, the wall or a hand: pure functions, with their thresholds.

The thresholds for hands and probes are measured: docs/detector-table.md gives their error rates.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from haptic_wall.controller.detector.half_cycles import Repeated

KEPT = 0.98
"""Least fraction of the amplitude that a persisting motion keeps over a cycle."""
DYING = 0.95
"""Ratio of amplitudes over a cycle in a decaying motion"""
_SAME_PERIOD = 0.12
"""Largest logarithm of the ratio of durations in a regular motion"""
_SATURATED, _SATURATED_PERIOD = 0.55, 0.3
"""Fraction of the torque limit that is the mean pull of a saturated motion, and its tolerance:
such a motion lengthens while it grows"""
_FASTER_THAN_HANDS_HZ, _SHARPER_THAN_HANDS = 15.0, 700.0
"""No hand moves a shaft to and fro by a degree as fast as this, nor reverses it with such an
acceleration [rad/s²]: 0.5 rad to either side at 6 Hz, 0.1 rad at 13 Hz"""
_POWERFUL = 40.0 * 7.0**3
"""Largest power of a hand on the wall times the cube of the frequency [W·Hz³]: 40 W at 7 Hz, 14 W
at 10 Hz. The alternating torque of a muscle, and the motion of a hand's mass under it, both fall
with the frequency. In thirty hours the operators of the tables gave up to 23 W."""
_FIRST, _SECOND, _BOTH = 1.05, 1.40, 2.6
"""The wall moves the shaft if the first and the second half-cycle of a probe, and their sum, are
longer than this; relative to the half-cycles before"""
_CONTACT, _CONTACTS = 1.6, 3.5
"""The same for the two contacts of a probe: least ratio of each, and of their sum. A hand's contact
is also longer at a softer wall, but not that much."""
_GROWN, _FIRST_GROWN = 1.3, 1.25
"""Growth from which the first one must be longer: a hand meets less resistance in the probe"""
_EXPLAINED, _EACH, _SUM = 0.78, 1.1, 2.4
"""Or if both are a little longer, by each and by the sum, while the torque explains this fraction
of the apparent inertia, and the amplitude has not grown"""
_UNSURE, _UNSURE_INERTIA, _AS_UNSURE = (1.18, 1.45), (0.35, 0.7), 0.06
"""Range of the second half-cycle and of the apparent inertia of a probe that cannot distinguish a
hand's motion from one that a hand only holds; and the agreement of two such answers"""
_LONGEST, _LARGEST = 3.2, 3.2
"""Ratio of a half-cycle, and of an amplitude, from which the motion is another one"""
_LONGEST_CONTACT, _DEEPEST_CONTACT, _HEAVIEST_CONTACT = 6.0, 6.0, 2.5
"""The same for a contact, and for the apparent inertia in it: an outside push raises all three"""
_APPARENT = 0.5, 1.6
"""Range of the apparent inertia in a probe over that before, if the torque still explains the
motion. A hand's motion seems lighter by the scale of the probe."""
_FADES_HZ = 8.0
"""Slower motions with constant period are hands'; others may be a load on its transmission."""
_SETTLED = 0.05
"""Largest logarithm of the change of an amplitude over a cycle in a limit cycle"""


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


def lasts(motion: Repeated) -> bool:
    """Whether the last two half-cycles kept their amplitude over a cycle."""
    return (
        motion.known >= 4
        and motion.amplitude > KEPT * motion.amplitude_3
        and motion.amplitude_2 > KEPT * motion.amplitude_4
    )


def same_period(motion: Repeated) -> bool:
    """Whether the last two half-cycles lasted as long as those a cycle before."""
    return (
        motion.known >= 4
        and abs(math.log(motion.duration / motion.duration_3)) < _SAME_PERIOD
        and abs(math.log(motion.duration_2 / motion.duration_4)) < _SAME_PERIOD
    )


def saturates(motion: Repeated, limit: float) -> bool:
    """Whether the last three half-cycles saturated the torque to either side, without decay.

    Args:
        motion: Half-cycles.
        limit: Of the torque [N·m].
    """
    return (
        motion.known >= 3
        and min(motion.pull, motion.pull_2, motion.pull_3) > _SATURATED * limit
        and motion.amplitude > KEPT * motion.amplitude_3
        and abs(math.log(motion.duration / motion.duration_3)) < _SATURATED_PERIOD
    )


def is_limit_cycle(motion: Repeated, limit: float) -> bool:
    """Whether the motion neither grows nor saturates: something other than the limit bounds it.

    Args:
        motion: Half-cycles.
        limit: Of the torque [N·m].
    """
    return (
        motion.known >= 4
        and abs(math.log(motion.amplitude / motion.amplitude_3)) < _SETTLED
        and abs(math.log(motion.amplitude_2 / motion.amplitude_4)) < _SETTLED
        and motion.pull < _SATURATED * limit
    )


def beyond_hands(cycle: float, amplitude: float, pull: float) -> bool:
    """Whether no hand moves a shaft like this.

    Args:
        cycle: Period [s].
        amplitude: At least a degree or so [rad].
        pull: Torque toward the middle, as that of half-cycles [N·m].
    """
    speed = amplitude * math.tau / cycle
    return (
        cycle * _FASTER_THAN_HANDS_HZ < 1.0
        or speed * math.tau / cycle > _SHARPER_THAN_HANDS
        or pull * speed > _POWERFUL * cycle**3
    )


def may_be_a_load(cycle: float) -> bool:
    """Whether a motion of this period [s] may be that of a load on its transmission."""
    return cycle * _FADES_HZ < 1.0


def explains(inertia: float, before: float) -> bool:
    """Whether the torque of a softer wall explains a motion as well as before.

    Args:
        inertia: Apparent inertia now [kg·m²].
        before: Apparent inertia on the whole wall [kg·m²].
    """
    least, most = _APPARENT
    return least * before < inertia < most * before


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


def took_longer(answer: Answer, *, contacts: bool) -> bool:
    """Whether a probe shows that the wall moves the shaft.

    Args:
        answer: Of the probe.
        contacts: It was of contacts with a one-sided wall.
    """
    first, second, inertia, amplitude = answer
    least, most = _APPARENT
    longest, largest = _LONGEST, _LARGEST
    if contacts:
        long = min(first, second) > _CONTACT and first + second > _CONTACTS
        longest, largest, most = _LONGEST_CONTACT, _DEEPEST_CONTACT, _HEAVIEST_CONTACT
    elif inertia > _EXPLAINED and amplitude < _GROWN:
        long = min(first, second) > _EACH and first + second > _SUM
    else:
        least_first = _FIRST if amplitude < _GROWN else _FIRST_GROWN
        long = first > least_first and second > _SECOND and first + second > _BOTH
    return long and second < longest and amplitude < largest and least < inertia < most


def as_unsure(one: Answer, other: Answer) -> bool:
    """Whether two probes have the same answer, which a hand's motion seldom gives twice.

    Args:
        one: An answer that shows no motion by the wall.
        other: That of the probe before.
    """
    least, most = _UNSURE
    light, heavy = _UNSURE_INERTIA
    return (
        all(a.first > _FIRST and least < a.second < most for a in (one, other))
        and all(light < a.inertia < heavy for a in (one, other))
        and abs(math.log(one.second / other.second)) < _AS_UNSURE
        and abs(one.inertia - other.inertia) < _AS_UNSURE
    )


def alike(one: Sighting, other: Sighting, period: float, amplitude: float) -> bool:
    """Whether two motions are one and the same.

    Args:
        one: A motion.
        other: Another one.
        period: Largest logarithm of the ratio of their periods.
        amplitude: Largest logarithm of the ratio of their amplitudes, either way.
    """
    return (
        abs(math.log(one.cycle / other.cycle)) < period
        and abs(math.log(one.amplitude / other.amplitude)) < amplitude
    )
