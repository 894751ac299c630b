"""Lists all tuned numbers of the detector: value, unit, meaning and source.

A run uses ``TUNING``. A study runs a variant of it: the settings of the detector carry the tuning.

Counts are counts of the encoder; where the detector judges growth, alarm and energy, a unit of the
torque over K if that is more. A half-cycle is the motion from one turning point to the next; its
amplitude is half the distance between them. A motion is the wall's if the wall moves the shaft by
itself, and a hand's if a person moves it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, TypeVar

T = TypeVar("T")

Rules = tuple[tuple[int, float], ...]
"""Numbers of half-cycles, ascending, and the growth of the logarithm of the amplitude over each"""

MANY: Final = 10**9
"""More half-cycles than any run has"""

ANY: Final = math.inf
"""More than any measured value"""

WALLS = "measured: detector-table, Walls that oscillate by themselves"
HANDS = "measured: detector-table, Hours of operators"
WALLS_HANDS = "measured: detector-table, Walls that oscillate by themselves and Hours of operators"
BACKLASH = "measured: detector-table, Small limit cycles of backlash"
KICKS = "measured: finished-investigations, after a kick"
KICKS_HANDS = "measured: finished-investigations, after a kick and believed hands"
CYCLES = "measured: finished-investigations, sustained oscillations and believed hands"
ANSWERS = (
    "measured: of 96 answers of walls 95 are so, of 24 longer ones of hands 6 (leaving out that of"
    " a motion that became smaller)"
)
CONTACT_ANSWERS = (
    "measured: of 19 answers of bouncing walls 16 are so, of 17 longer ones of hands 6"
)
RECORDINGS = "measured: finished-investigations, recordings"


@dataclass(frozen=True, slots=True)
class Origin:
    """Unit, meaning and source of a tuned number; the metadata of its field."""

    unit: str
    """1 for a ratio or a number of things"""
    meaning: str
    source: str
    """Measurement that it was chosen with, or arithmetic, physics or paper that it follows from"""
    off: object
    """Value with which its criterion has no effect; None: it is a scale, which has no such value"""


def tuned(value: T, unit: str, meaning: str, source: str, off: object = None) -> T:
    """Return a field of a tuning: its default, and its ``Origin``."""
    made: T = field(default=value, metadata={"origin": Origin(unit, meaning, source, off)})
    return made


@dataclass(frozen=True, slots=True)
class HalfCycleTuning:
    """Where a motion turns, and when it has stopped."""

    turning_counts: float = tuned(
        1.5,
        "counts",
        "The motion leaves a turning point by this much.",
        "quantisation: a position that rests between two counts flickers by one",
    )
    turning_fraction: float = tuned(
        0.05,
        "1",
        "The motion leaves a turning point by this fraction of the last half-cycle's length too.",
        WALLS_HANDS,
        off=0.0,
    )
    ripple: float = tuned(
        0.35,
        "1",
        "A half-cycle is a ripple if its amplitude is below this fraction of the largest lately.",
        "measured: detector-table, Walls that oscillate by themselves, two masses",
        off=0.0,
    )
    forgets: float = tuned(
        0.8,
        "1",
        "The largest amplitude lately shrinks by this factor in each half-cycle.",
        "measured: detector-table, Walls that oscillate by themselves, two masses",
        off=0.0,
    )
    coarse: float = tuned(
        0.25,
        "1",
        "After a ripple the motion leaves a turning point by this fraction of the largest length"
        " lately, so that a ripple ends no half-cycle.",
        "measured: detector-table, Walls that oscillate by themselves, two masses",
        off=0.0,
    )
    coarse_half_cycles: int = tuned(
        20,
        "1",
        "Turning points are coarse for so many half-cycles after a ripple.",
        "measured: detector-table, Walls that oscillate by themselves, two masses",
        off=0,
    )
    still: float = tuned(
        3.0,
        "half-cycles",
        "A motion has stopped if no turning point has come for this long.",
        WALLS_HANDS,
    )


@dataclass(frozen=True, slots=True)
class ContactTuning:
    """Contacts with a one-sided wall, and whether it throws the shaft back."""

    gate_counts: float = tuned(
        8.0,
        "counts",
        "The speeds before and after a contact are taken between the surface and a gate this far"
        " outside.",
        "quantisation: a passage of eight counts is known to a quarter, one count at either end",
    )
    gate_rad: float = tuned(
        0.005,
        "rad",
        "The same where the encoder has no counts.",
        "quantisation: about the gate of an encoder with 10,000 counts a turn",
    )
    smoothing: float = tuned(
        0.4,
        "1",
        "The smoothed gain takes this fraction of a new gain.",
        "arithmetic: a mean over some two contacts",
        off=1.0,
    )
    thrown: float = tuned(
        0.2,
        "1",
        "A contact throws the shaft back if the logarithm of exit speed over entry speed is above"
        " this.",
        HANDS,
        off=ANY,
    )
    bounce: float = tuned(
        1.5,
        "half-cycles",
        "A bounce lasts at most so many half-cycles of the heaviest servo. A hand stays longer.",
        "physics: a free bounce lasts one half-cycle; half of one more for the load and the lag",
        off=ANY,
    )


@dataclass(frozen=True, slots=True)
class SteadinessTuning:
    """Half-cycles that repeat as evenly as a machine makes them and no hand does."""

    half_cycles: int = tuned(
        40, "1", "No hand makes so many half-cycles in a row so evenly.", HANDS, off=MANY
    )
    amplitude: float = tuned(
        0.02,
        "1",
        "An amplitude differs from the first one by at most this fraction of it.",
        "measured: detector-table, Small limit cycles of backlash and Hours of operators",
    )
    amplitude_counts: float = tuned(
        0.6,
        "counts",
        "Or by at most so many counts.",
        "quantisation: two turning points, each known to half a count, are half an amplitude each",
        off=0.0,
    )
    duration: float = tuned(
        0.03,
        "1",
        "A duration differs from the first one by at most this fraction of it.",
        "measured: detector-table, Small limit cycles of backlash and Hours of operators",
    )
    duration_periods: float = tuned(
        2.1,
        "periods",
        "Or by at most so many periods.",
        "quantisation: two turning points, each known to a period, and rounding",
        off=0.0,
    )


@dataclass(frozen=True, slots=True)
class EvidenceTuning:
    """Evidence that a motion shows without a probe."""

    kept: float = tuned(
        0.98,
        "1",
        "A motion that does not die keeps this fraction of its amplitude over a cycle.",
        WALLS_HANDS,
        off=0.0,
    )
    dying: float = tuned(
        0.95,
        "1",
        "A motion dies if its amplitude is below this fraction of that a cycle before.",
        WALLS,
        off=0.0,
    )
    regular_period: float = tuned(
        0.12,
        "1",
        "In a regular motion the logarithm of the ratio of durations a cycle apart is below this.",
        WALLS_HANDS,
        off=ANY,
    )
    saturated: float = tuned(
        0.55,
        "1",
        "A motion saturates the torque if its mean pull is above this fraction of the limit.",
        "arithmetic: a linear spring that just reaches the limit has 0.5, a saturated one up to 1",
        off=ANY,
    )
    saturated_period: float = tuned(
        0.3,
        "1",
        "The same logarithm for a motion that saturates the torque: it lengthens while it grows.",
        WALLS,
        off=ANY,
    )
    settled: float = tuned(
        0.05,
        "1",
        "In a limit cycle the logarithm of the ratio of amplitudes a cycle apart is below this.",
        BACKLASH,
        off=ANY,
    )
    hands_hz: float = tuned(
        15.0, "Hz", "No hand moves a shaft to and fro by a degree faster than this.", HANDS, off=ANY
    )
    hands_acceleration: float = tuned(
        700.0,
        "rad/s²",
        "No hand turns a shaft around with more: 0.5 rad to either side at 6 Hz, 0.1 rad at 13 Hz.",
        HANDS,
        off=ANY,
    )
    hands_power: float = tuned(
        40.0 * 7.0**3,
        "W·Hz³",
        "No hand gives the wall more power than this over the cube of the frequency: 40 W at 7 Hz,"
        " 14 W at 10 Hz. The torque of a muscle, and the distance that the mass of a hand goes,"
        " both fall with the frequency.",
        "measured: finished-investigations, hours of operators: up to 23 W at 7 Hz in thirty hours",
        off=ANY,
    )


@dataclass(frozen=True, slots=True)
class ProbeTuning:
    """How a probe changes the wall, and what its two half-cycles or contacts show.

    Durations, amplitudes and apparent inertias are relative to those before the probe.
    """

    scale: float = tuned(
        0.25,
        "1",
        "Elastic torque, its limit and damping have this scale in a probe; each step of the"
        " reduction has it once more.",
        "physics: a linear period doubles; at a half it would be 1.4 times as long, too little",
    )
    first: float = tuned(
        1.05,
        "1",
        "The wall's first half-cycle in a probe is longer than this.",
        WALLS_HANDS,
        off=0.0,
    )
    second: float = tuned(
        1.40,
        "1",
        "The wall's second half-cycle in a probe is longer than this.",
        WALLS_HANDS,
        off=0.0,
    )
    both: float = tuned(2.6, "1", "The sum of the two is longer than this.", WALLS_HANDS, off=0.0)
    grown: float = tuned(
        1.3,
        "1",
        "A motion has grown in the probe if its amplitude is above this: a hand meets less"
        " resistance.",
        HANDS,
        off=ANY,
    )
    first_grown: float = tuned(
        1.25, "1", "Then the wall's first half-cycle is longer than this.", HANDS, off=1.05
    )
    explained: float = tuned(
        0.78,
        "1",
        "The torque explains a motion that has not grown if its apparent inertia is above this: on"
        " a wall with a quarter of its torque a hand's motion seems two or three times as light.",
        WALLS_HANDS,
        off=ANY,
    )
    explained_each: float = tuned(
        1.1,
        "1",
        "Then either half-cycle of the wall's motion is longer than this.",
        WALLS_HANDS,
        off=0.0,
    )
    explained_both: float = tuned(
        2.4, "1", "And their sum is longer than this.", WALLS_HANDS, off=0.0
    )
    contact: float = tuned(
        1.6,
        "1",
        "At a one-sided wall either contact of the wall's motion is longer than this. A hand's"
        " contact lasts longer too, but less.",
        "measured: detector-table, One-sided walls under a steady push and Hours of operators",
        off=0.0,
    )
    contacts: float = tuned(
        3.5,
        "1",
        "And the sum of two contacts is longer than this.",
        "measured: detector-table, One-sided walls under a steady push and Hours of operators",
        off=0.0,
    )
    longest: float = tuned(
        3.2,
        "1",
        "A longer second half-cycle is another motion's. Under a load that all but pushes through"
        " the probed wall the wall's motion becomes so slow; a hand's does not.",
        WALLS_HANDS,
        off=ANY,
    )
    largest: float = tuned(
        3.2, "1", "A motion of a larger amplitude is another one.", WALLS_HANDS, off=ANY
    )
    longest_contact: float = tuned(
        6.0, "1", "A longer second contact is a push from outside.", HANDS, off=ANY
    )
    deepest_contact: float = tuned(
        6.0, "1", "A deeper contact is a push from outside.", HANDS, off=ANY
    )
    heaviest_contact: float = tuned(
        2.5, "1", "A contact with a larger apparent inertia is a push from outside.", HANDS, off=ANY
    )
    lightest: float = tuned(
        0.5,
        "1",
        "The softer wall's torque explains a motion if its apparent inertia is above this. What a"
        " hand moves seems lighter by the scale of the probe.",
        WALLS_HANDS,
        off=0.0,
    )
    heaviest: float = tuned(1.6, "1", "And below this.", WALLS_HANDS, off=ANY)
    clear: float = tuned(
        1.12,
        "1",
        "A longer answer is clear if either half-cycle is longer than this,",
        ANSWERS,
        off=0.0,
    )
    clear_longest: float = tuned(2.9, "1", "shorter than this,", ANSWERS, off=ANY)
    clear_both: float = tuned(2.9, "1", "their sum is longer than this,", ANSWERS, off=0.0)
    clear_ratio: float = tuned(
        1.95, "1", "the ratio of the second to the first below this,", ANSWERS, off=ANY
    )
    clear_lightest: float = tuned(0.6, "1", "the apparent inertia above this", ANSWERS, off=0.0)
    clear_heaviest: float = tuned(1.5, "1", "and below this,", ANSWERS, off=ANY)
    clear_largest: float = tuned(
        2.2,
        "1",
        "and the amplitude below this. A hand's answer that is long by chance is seldom so even;"
        " what is not clear is probed once more.",
        ANSWERS,
        off=ANY,
    )
    clear_smaller: float = tuned(
        1.2,
        "1",
        "Or if the amplitude became smaller and either half-cycle is longer than this",
        ANSWERS,
        off=ANY,
    )
    clear_explained: float = tuned(
        0.85,
        "1",
        "and the apparent inertia above this: a motion that saturated the torque.",
        ANSWERS,
        off=ANY,
    )
    clear_contact: float = tuned(
        1.7,
        "1",
        "A longer answer of two contacts is clear if either is longer than this,",
        CONTACT_ANSWERS,
        off=0.0,
    )
    clear_longest_contact: float = tuned(4.5, "1", "shorter than this,", CONTACT_ANSWERS, off=ANY)
    clear_lightest_contact: float = tuned(
        0.65, "1", "the apparent inertia above this", CONTACT_ANSWERS, off=0.0
    )
    clear_heaviest_contact: float = tuned(1.7, "1", "and below this,", CONTACT_ANSWERS, off=ANY)
    clear_deepest: float = tuned(2.6, "1", "and the depth below this.", CONTACT_ANSWERS, off=ANY)
    confirmed_s: float = tuned(
        5.0,
        "s",
        "A second longer answer within this time confirms one that was not clear,",
        HANDS,
        off=ANY,
    )
    confirmed_cycles: float = tuned(
        12.0, "cycles", "or within this time, if that is longer,", HANDS, off=0.0
    )
    confirmed_period: float = tuned(
        0.25,
        "1",
        "if the logarithm of the ratio of the periods before the two is below this.",
        HANDS,
        off=ANY,
    )
    unsure_shortest: float = tuned(
        1.18,
        "1",
        "A probe is unsure whether a hand moves or only holds the shaft if the second half-cycle is"
        " longer than this,",
        "physics: a hand that holds is a spring beside the wall's, so that the period changes less",
        off=0.0,
    )
    unsure_longest: float = tuned(1.45, "1", "shorter than this,", HANDS, off=ANY)
    unsure_lightest: float = tuned(0.35, "1", "and the apparent inertia above this", HANDS, off=0.0)
    unsure_heaviest: float = tuned(0.7, "1", "and below this.", HANDS, off=ANY)
    unsure_alike: float = tuned(
        0.06,
        "1",
        "Two unsure probes are the wall's if the logarithm of the ratio of their second half-cycles"
        " and the difference of their inertias are below this. A hand seldom answers twice alike.",
        HANDS,
        off=0.0,
    )
    same_period: float = tuned(
        0.1,
        "1",
        "Two motions at two times are the same if the logarithm of the ratio of their periods is"
        " below this,",
        WALLS_HANDS,
        off=ANY,
    )
    same_amplitude: float = tuned(
        0.5, "1", "and that of their amplitudes below this.", WALLS_HANDS, off=ANY
    )
    early: float = tuned(
        0.15,
        "half-cycles",
        "A probe that began within this time of a turning point counts the present half-cycle.",
        WALLS,
        off=ANY,
    )
    collapsed: float = tuned(
        0.6,
        "1",
        "A motion has stopped in the probe if its amplitude is below this.",
        WALLS_HANDS,
        off=0.0,
    )
    quicker: float = tuned(
        0.8,
        "1",
        "Unless its first half-cycle is shorter than this: it is another motion, because no wall"
        " makes a motion quicker by giving way.",
        HANDS,
        off=0.0,
    )
    load_hz: float = tuned(
        8.0,
        "Hz",
        "A motion whose period stays may be a load on its transmission above this frequency, and is"
        " a hand's below.",
        "measured: detector-table, Walls that oscillate by themselves, two masses, and Hours of"
        " operators, tremor",
        off=ANY,
    )
    load_size: float = tuned(
        2.5,
        "thresholds",
        "And if its amplitude is above this; a smaller one may be tremor.",
        "measured: detector-table, Hours of operators, tremor",
        off=0.0,
    )
    load_each: float = tuned(
        0.985,
        "1",
        "A load on its transmission fades to this fraction or less in each half-cycle,",
        "measured: detector-table, Walls that oscillate by themselves, two masses",
        off=ANY,
    )
    load_all: float = tuned(
        0.75,
        "1",
        "to less than this fraction of its amplitude in all,",
        "measured: detector-table, Walls that oscillate by themselves, two masses",
        off=0.0,
    )
    load_half_cycles: int = tuned(
        8,
        "1",
        "and within so many half-cycles.",
        "measured: detector-table, Walls that oscillate by themselves, two masses",
        off=MANY,
    )


@dataclass(frozen=True, slots=True)
class BackstopTuning:
    """Which motion is probed, and what follows an alarm."""

    large_counts: float = tuned(
        10.0,
        "counts",
        "A motion is probed from this amplitude on: the threshold.",
        "measured: detector-table, Small limit cycles of backlash and Hours of operators",
    )
    large_rad: float = tuned(
        0.01745,
        "rad",
        "The same where the encoder has no counts.",
        "chosen: one degree, about ten counts of 4096",
    )
    small_counts: float = tuned(
        3.0,
        "counts",
        "A motion that is suspected or steady is probed from this amplitude on.",
        "quantisation: an encoder keeps up one or two counts by its steps alone",
    )
    small_rad: float = tuned(
        0.005,
        "rad",
        "The same where the encoder has no counts.",
        "chosen: about three counts of 4096",
    )
    loaded: float = tuned(
        0.6,
        "1",
        "A motion with a mean torque above this fraction of the limit is not probed: the wall holds"
        " the load, but has little torque left beyond it.",
        "arithmetic: a tenth of the limit is left on the load's side",
        off=ANY,
    )
    loaded_contacts: float = tuned(
        0.24,
        "1",
        "Contacts with a mean torque above this fraction of the limit are not probed: their load"
        " pushes through the probed wall.",
        "arithmetic: just below the scale of the probe",
        off=ANY,
    )
    least_gain: float = tuned(
        -0.05,
        "1",
        "Contacts die by themselves if the logarithm of exit speed over entry speed is below this.",
        HANDS,
        off=-ANY,
    )
    throws: int = tuned(
        3, "1", "So many contacts in a row that throw the shaft back are probed.", HANDS, off=MANY
    )
    throws_loaded: int = tuned(
        12,
        "1",
        "So many of them end the run where a load forbids the probe.",
        "measured: detector-table, Hours of operators, tap",
        off=MANY,
    )
    regular: int = tuned(
        2,
        "1",
        "A motion is regular if so many half-cycles in a row kept amplitude and period.",
        WALLS_HANDS,
        off=0,
    )
    loss: float = tuned(
        0.005,
        "1",
        "A regular motion dies, and is not probed, if it loses more than this fraction a cycle",
        "chosen: a stable wall without friction loses some percent a cycle",
        off=ANY,
    )
    loss_counts: float = tuned(
        0.45,
        "counts",
        "and more than so many counts",
        "quantisation: the mean of two amplitudes comes in quarters of a count, and is off by 0.18"
        " (standard deviation), so that two of them seldom differ by half a count",
    )
    loss_half_cycles: int = tuned(
        6, "1", "within at most so many half-cycles.", "chosen: half of the time for an answer"
    )
    regular_told: int = tuned(
        12,
        "1",
        "So many regular half-cycles are called sustained where the wall is only watched.",
        WALLS_HANDS,
        off=MANY,
    )
    regular_long: int = tuned(
        20,
        "1",
        "So many of them end the run where a load forbids the probe and the torque explains the"
        " motion; where a hand was found a moment ago, they are probed again.",
        "measured: detector-table, One-sided walls under a steady push and Hours of operators",
        off=MANY,
    )
    gentle_loaded: int = tuned(
        24,
        "1",
        "So many of them that grow gently end such a run if the apparent inertia is larger, as of a"
        " weight: a hand that swings up grows faster.",
        "measured: in 5 hours of hands the longest row had 9, each further one half as often",
        off=MANY,
    )
    gentle: float = tuned(1.2, "1", "They grow by less than this ratio a cycle.", HANDS, off=ANY)
    regular_unlikely: int = tuned(
        10,
        "1",
        "So many of them are probed though the servo cannot have the apparent inertia.",
        WALLS_HANDS,
        off=MANY,
    )
    lightest: float = tuned(
        0.8,
        "1",
        "The servo may have an apparent inertia from this ratio to the least believed one on,",
        "physics: friction and the lag of the torque change what the inertia seems to be",
        off=0.0,
    )
    heaviest: float = tuned(
        1.6,
        "1",
        "up to this ratio to the largest believed one.",
        "physics: friction and the lag of the torque change what the inertia seems to be",
        off=ANY,
    )
    beyond_half_cycles: int = tuned(
        8,
        "1",
        "A motion beyond hands goes on if the largest of so many half-cycles has kept the amplitude"
        " of as many before, regular or not.",
        "measured: detector-table, Walls that oscillate by themselves, two masses",
        off=MANY,
    )
    held_off_s: float = tuned(
        10.0,
        "s",
        "A motion like the one that a hand made is not probed again for this time.",
        "chosen: how often a person may feel a probe of one and the same motion",
        off=0.0,
    )
    other_period: float = tuned(
        0.25,
        "1",
        "A motion is like that one if the logarithm of the ratio of their periods is below this,",
        HANDS,
        off=ANY,
    )
    other_amplitude: float = tuned(
        1.6, "1", "and its amplitude is below this ratio.", WALLS_HANDS, off=ANY
    )
    again_s: float = tuned(
        5.0,
        "s",
        "A motion that stopped in a probe is the wall's if it is back within this time.",
        WALLS_HANDS,
        off=0.0,
    )
    stops: int = tuned(
        3,
        "1",
        "So many stops in probes, each within that time of the one before, are the wall's whatever"
        " the motion: a load changes its period.",
        WALLS_HANDS,
        off=MANY,
    )
    hand_shortest: float = tuned(
        0.85,
        "1",
        "A hand moves the reduced wall if the period is above this ratio to that before the alarm,",
        HANDS,
        off=0.0,
    )
    hand_longest: float = tuned(
        1.25, "1", "below this ratio at the first step of the reduction,", HANDS, off=0.0
    )
    hand_longest_later: float = tuned(1.6, "1", "below this ratio at a later step,", HANDS, off=0.0)
    hand_smallest: float = tuned(
        0.4,
        "1",
        "and its amplitude is above this ratio: where the torque saturated, a much smaller motion"
        " of the wall has the same period.",
        WALLS,
        off=0.0,
    )
    own_first: float = tuned(
        1.3,
        "1",
        "A motion is the wall's without doubt if the period is above this ratio to that before the"
        " alarm at the first step of the reduction,",
        "physics: a linear spring makes it 2; between that and what a hand keeps",
        off=0.0,
    )
    own_second: float = tuned(
        2.0,
        "1",
        "above this ratio at the second step,",
        "physics: a linear spring makes it 4",
        off=0.0,
    )
    own_third: float = tuned(
        3.0,
        "1",
        "and above this ratio at the third.",
        "physics: a linear spring makes it 8",
        off=0.0,
    )
    reduced_half_cycles: int = tuned(
        4,
        "1",
        "The wall's motion on the reduced wall ends the run after so many half-cycles at least.",
        "arithmetic: two cycles on the same wall can be compared",
        off=0,
    )
    reduced_gain: float = tuned(
        0.1,
        "1",
        "Contacts with a reduced wall end the run if the logarithm of exit speed over entry speed"
        " is above this.",
        "measured: detector-table, Hours of operators, tap",
        off=0.0,
    )
    hand_half_cycles: int = tuned(
        6,
        "1",
        "So many half-cycles of undying motion on the softest wall are a hand's.",
        HANDS,
        off=MANY,
    )
    steps: int = tuned(
        3, "1", "The reduction has so many steps: K goes to a quarter, a sixteenth, a 64th.", WALLS
    )
    backlash: float = tuned(
        4.0,
        "thresholds",
        "Backlash is named for limit cycles up to this amplitude.",
        BACKLASH,
        off=ANY,
    )
    rest_between: float = tuned(
        4.0,
        "1",
        "The wall comes back at so many times the torque if its spring passed its rest between two"
        " samples.",
        "physics: a fast motion passes the surface between two samples",
        off=1.0,
    )
    rest_counts: float = tuned(
        2.0,
        "counts",
        "The spring is at rest within so many counts, however stiff it is.",
        "quantisation: a position at rest is known to one count, and the surface too",
        off=0.0,
    )
    cycles: float = tuned(
        6.0,
        "cycles",
        "A motion must die within so many cycles of the slowest motion that K allows,",
        "chosen: what the page promises",
        off=ANY,
    )
    longest_s: float = tuned(
        5.0, "s", "and within this time.", "chosen: what the page promises", off=ANY
    )
    hurry: float = tuned(
        0.9,
        "1",
        "A motion that does not die ends the run after this fraction of that time.",
        "chosen: a half-cycle must end before the time is over",
    )


@dataclass(frozen=True, slots=True)
class HoldTuning:
    """How a load is held while the wall is softer."""

    least: float = tuned(
        0.05,
        "1",
        "A load below this fraction of the torque limit is not held.",
        "chosen: it sinks by an eighth of what saturates the whole spring; the mean torque of a"
        " motion without a load is seldom more",
        off=ANY,
    )
    room: float = tuned(
        0.25,
        "1",
        "The load is held up to this fraction of the amplitude beyond the turning points; the"
        " middle of a motion is known as well.",
        "chosen: a motion that grows by half in each half-cycle is still about its middle",
        off=ANY,
    )
    settled: float = tuned(
        1.5,
        "half-cycles",
        "The wall's torque is the load's if no turning point has come for so many half-cycles, by"
        " the second longest of the last three,",
        "chosen: a motion that goes on turns around before",
        off=ANY,
    )
    rests_s: float = tuned(
        0.075,
        "s",
        "and the whole spring's torque has changed by less than what is held at least for so long"
        " over the root of the present spring's scale.",
        "chosen: a creeping shaft is at rest, a swinging one is not",
        off=ANY,
    )
    slack: float = tuned(
        0.1,
        "1",
        "On a wall that stays reduced, what is held follows where the spring about it carries more"
        " than this fraction of its limit.",
        "chosen: the mean torque of a decaying motion is less",
        off=0.0,
    )
    follows_s: float = tuned(
        0.5,
        "s",
        "What is held follows the load with this time constant.",
        "chosen: longer than a half-cycle on most reduced walls",
    )


@dataclass(frozen=True, slots=True)
class BeliefTuning:
    """The detector that knows the believed servo: growth and regularity of explained motion.

    A half-cycle is explained if the acting torque pays for the motion that is believed of the
    servo. Growth is that of the amplitude's logarithm.
    """

    filter: float = tuned(
        0.25,
        "1",
        "The filter's time constant, times the expected angular frequency.",
        "physics: it turns counts into a velocity, and the sums are right for any filter",
    )
    filter_s: float = tuned(
        0.05, "s", "The filter's time constant is at most this.", KICKS, off=ANY
    )
    sustained: int = tuned(
        40,
        "1",
        "An explained motion is a limit cycle if so many half-cycles stay the same.",
        CYCLES,
    )
    grown: tuple[tuple[int, float], ...] = tuned(
        ((3, 0.50), (4, 0.50), (6, 0.50), (8, 0.55)),
        "1",
        "An explained motion is an alarm if it grows by so much over so many half-cycles.",
        KICKS_HANDS,
    )
    straight: float = tuned(
        0.01,
        "1",
        "The amplitude's logarithm then scatters by less than this about a straight line.",
        KICKS_HANDS,
        off=ANY,
    )
    scatter_counts: float = tuned(
        0.2,
        "counts",
        "The encoder's part of such a scatter, by the amplitude.",
        "quantisation: rms error of the difference of two rounded positions, halved",
        off=0.0,
    )
    least_counts: float = tuned(
        8.0,
        "counts",
        "Growth is told from the encoder's steps from this amplitude on.",
        "quantisation: a step is an eighth of it or less",
    )
    outward: float = tuned(
        0.4,
        "1",
        "A motion is an alarm if the distance from the wall grows by this logarithm over explained"
        " half-cycles,",
        KICKS_HANDS,
        off=ANY,
    )
    outward_half_cycles: int = tuned(2, "1", "so many at least,", KICKS_HANDS, off=1)
    outward_each: float = tuned(
        0.5,
        "1",
        "either of the last two by at least this fraction of the mean.",
        KICKS_HANDS,
        off=0.0,
    )
    grows_on: float = tuned(
        0.6,
        "1",
        "The last half-cycle grows by at least this fraction of the mean: a hand's motion grows and"
        " then stays.",
        "measured: finished-investigations, believed hands",
        off=-ANY,
    )
    grown_evenly: tuple[tuple[int, float], ...] = tuned(
        ((16, 0.28), (24, 0.28)),
        "1",
        "An explained motion that grows as evenly as no hand's is an alarm from this growth on.",
        KICKS_HANDS,
    )
    grown_unpaid: tuple[tuple[int, float], ...] = tuned(
        ((8, 0.64), (24, 0.7)),
        "1",
        "The same of a motion that only the inertia explains, because delay or friction are far"
        " from what is believed.",
        KICKS_HANDS,
    )
    unpaid_counts: float = tuned(
        16.0, "counts", "That is told from this amplitude on,", KICKS_HANDS
    )
    unpaid_scatter_counts: float = tuned(
        0.1,
        "counts",
        "and this is the encoder's part of its scatter, by the amplitude.",
        KICKS_HANDS,
        off=0.0,
    )
    regular: float = tuned(
        0.008, "1", "No hand keeps the scatter of the amplitude's logarithm below this.", CYCLES
    )
    no_loss: float = tuned(
        5e-4,
        "1",
        "A motion goes on if it loses less than this in each half-cycle.",
        CYCLES,
        off=0.0,
    )
    steady: float = tuned(
        0.01,
        "1",
        "A motion grows if it gains more than this in each half-cycle; it decays if it loses more.",
        CYCLES,
    )
    shrinks: float = tuned(
        0.04,
        "1",
        "An alarm ends if the motion loses more than this in each of two half-cycles.",
        KICKS,
        off=ANY,
    )
    alarm_counts: float = tuned(
        3.5,
        "counts",
        "A sustained oscillation is an alarm from this amplitude on.",
        "quantisation: a lightly damped wall of any stiffness keeps up one or two counts",
        off=0.0,
    )
    first_counts: float = tuned(
        8.0,
        "counts",
        "The energy that the wall gives out is judged after this distance from rest,",
        KICKS_HANDS,
        off=0.0,
    )
    later_counts: float = tuned(
        14.0,
        "counts",
        "and after this distance in later half-cycles, in which a hand may have a part.",
        KICKS_HANDS,
        off=0.0,
    )
    symmetric: float = tuned(
        0.9,
        "1",
        "The logarithm of the ratio of two amplitudes in a row is below this in one motion.",
        KICKS_HANDS,
        off=ANY,
    )
    bounces: int = tuned(
        12,
        "1",
        "Bounces off a one-sided wall are an alarm if they grow over so many half-cycles,",
        "measured: docs/detector.md, One-sided walls close to their limit",
    )
    bounces_grown: float = tuned(0.25, "1", "by more than this,", KICKS_HANDS, off=0.0)
    bounces_back: float = tuned(
        0.01,
        "1",
        "and none is smaller than the one before by more than this.",
        KICKS_HANDS,
        off=ANY,
    )


@dataclass(frozen=True, slots=True)
class StreakTuning:
    """How alike the remainders of explained half-cycles in a row are."""

    damping: float = tuned(
        0.03,
        "1",
        "The damping that the torque leaves over, by m ω, differs by at most this in a streak,",
        KICKS_HANDS,
        off=ANY,
    )
    damping_counts: float = tuned(
        0.525,
        "counts",
        "and by this much more, by the amplitude.",
        "measured: finished-investigations, after a kick: 1.5 times `energy.loss_counts`",
        off=0.0,
    )
    inertia: float = tuned(
        0.2,
        "1",
        "The inertia that the torque seems to move, by the believed one, differs by at most this,",
        KICKS_HANDS,
        off=ANY,
    )
    inertia_counts: float = tuned(
        1.0,
        "counts",
        "and by this much more, by the amplitude.",
        "quantisation: an amplitude is known to half a count, its square to twice that part",
        off=0.0,
    )


@dataclass(frozen=True, slots=True)
class EnergyTuning:
    """Room for a belief that is wrong by a fifth, and for the encoder's steps."""

    wrong: float = tuned(
        0.3,
        "1",
        "Friction and delay may be larger than believed by this fraction.",
        "arithmetic: a value believed a fifth too low is a quarter larger; some more for the rest",
        off=0.0,
    )
    delay: float = tuned(
        0.15,
        "1",
        "The damping that balances the delay may be larger by this fraction of K t_d.",
        "arithmetic: with a delay believed a fifth too long, a wall at nine tenths of its limit"
        " seems to give out nearly a tenth",
        off=0.0,
    )
    clear: float = tuned(
        0.06,
        "1",
        "The wall gives out energy if more than this fraction of the motion's is left over,",
        KICKS_HANDS,
        off=0.0,
    )
    counts: float = tuned(
        0.6,
        "counts",
        "and the work of this much elongation along the way.",
        "quantisation: the torque of a count acts after the count, half a count late on the mean",
        off=0.0,
    )
    fewest_periods: float = tuned(
        2.5,
        "periods",
        "It is asked from this time after a turning point on.",
        "quantisation: a turning point that no sample has met is known to one period",
        off=0.0,
    )
    lightest: float = tuned(
        1.0 / 1.3,
        "1",
        "The torque moves the servo's inertia if it seems to be above this ratio to the believed"
        " one,",
        "arithmetic: an inertia that is believed a fifth too high, and some more",
        off=0.0,
    )
    heaviest: float = tuned(
        1.4,
        "1",
        "and below this ratio.",
        "arithmetic: an inertia that is believed a fifth too low, and damping that acts late",
        off=ANY,
    )
    inertia_counts: float = tuned(
        1.0,
        "counts",
        "Either bound is wider by this, by the amplitude.",
        "quantisation: an amplitude is known to half a count, its square to twice that part",
        off=0.0,
    )
    loss: float = tuned(
        0.02,
        "1",
        "The torque pays for friction to this fraction of m ω, whatever is believed,",
        "measured: the filter's own error",
        off=0.0,
    )
    loss_counts: float = tuned(
        0.35,
        "counts",
        "and to this much more, by the amplitude.",
        "measured: finished-investigations, after a kick",
        off=0.0,
    )


@dataclass(frozen=True, slots=True)
class WatchTuning:
    """When the watch ends a run by energy, and when passivity control is outgrown."""

    given_j: float = tuned(
        0.02,
        "J",
        "A one-sided wall ends the run if it gives out more in a bounce, beyond what it took and"
        " friction may eat.",
        HANDS,
        off=ANY,
    )
    outgrown: float = tuned(
        1.25,
        "1",
        "A motion that goes so much further than before the alarm is more than passivity control"
        " can hold.",
        "chosen: what the page promises",
    )


@dataclass(frozen=True, slots=True)
class RecordingTuning:
    """Numbers for recordings made by other programs: gaps, counts, servo and wall."""

    gap_s: float = tuned(
        0.05,
        "s",
        "The motion is looked at anew after a longer gap.",
        "physics: turning points of a motion of 10 Hz may have passed unseen",
        off=ANY,
    )
    count_steps: int = tuned(
        20,
        "1",
        "So many steps of the position are at least needed to tell a count.",
        "arithmetic: fewer steps are multiples of the smallest by chance",
        off=1,
    )
    servo_cycles: float = tuned(
        1.5, "cycles", "A recording tells its servo from so many cycles on.", RECORDINGS, off=0.0
    )
    servo_window: float = tuned(
        0.6,
        "cycles",
        "Length of the window that weights the motion where the servo is estimated.",
        RECORDINGS,
    )
    servo_finite: float = tuned(
        0.95,
        "1",
        "At least this fraction of the samples is there.",
        "chosen: what interpolation may fill",
        off=0.0,
    )
    servo_unexplained: float = tuned(
        0.15,
        "1",
        "An inertia and a damping leave at most this fraction of the torque unexplained, rms.",
        RECORDINGS,
        off=ANY,
    )
    wall_samples: int = tuned(
        30,
        "1",
        "A wall is estimated from so many samples with a torque on.",
        "arithmetic: ten for each of three unknowns",
        off=3,
    )
    wall_unexplained: float = tuned(
        0.03,
        "1",
        "A wall leaves at most this fraction of its torque unexplained, rms.",
        RECORDINGS,
        off=ANY,
    )
    wall_free: float = tuned(
        0.02,
        "1",
        "A wall is one-sided if more than this fraction of the samples has no torque.",
        "chosen: more than the samples in which the torque passes zero",
    )


@dataclass(frozen=True, slots=True)
class Tuning:
    """All of them, by what they are for."""

    half_cycles: HalfCycleTuning = HalfCycleTuning()
    contacts: ContactTuning = ContactTuning()
    steadiness: SteadinessTuning = SteadinessTuning()
    evidence: EvidenceTuning = EvidenceTuning()
    probe: ProbeTuning = ProbeTuning()
    backstop: BackstopTuning = BackstopTuning()
    hold: HoldTuning = HoldTuning()
    belief: BeliefTuning = BeliefTuning()
    streaks: StreakTuning = StreakTuning()
    energy: EnergyTuning = EnergyTuning()
    watch: WatchTuning = WatchTuning()
    recording: RecordingTuning = RecordingTuning()


TUNING: Final = Tuning()
"""The tuning of the oscillation watch in every run"""
