"""Lists the tuned numbers of the oscillation detector.

Counts are counts of the encoder. A half-cycle is the motion from one turning point to the next; its
amplitude is half the distance between them. Durations, amplitudes and apparent inertias in a probe
are relative to those before it. The numbers without an arithmetic reason were chosen with trials
like those of docs/evidence/detector-table.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Tuning:
    """All of them, in the order in which a motion meets them."""

    # Where a motion turns
    turning_counts: float = 1.5
    """The motion leaves a turning point by this much: a position between two counts flickers
    by one [counts]."""
    turning_fraction: float = 0.05
    """It leaves it by this fraction of the last half-cycle's length too [1]."""
    still: float = 3.0
    """A motion has stopped if no turning point has come for so many half-cycles [1]."""

    # Contacts with a one-sided wall
    gate_counts: float = 8.0
    """Speeds are taken between the surface and a gate this far outside: a passage of eight counts
    is known to a quarter [counts]."""
    gate_rad: float = 0.005
    """The same without counts [rad]"""
    smoothing: float = 0.4
    """The smoothed gain takes this fraction of a new gain: a mean over some two contacts [1]."""
    thrown: float = 0.2
    """A contact throws the shaft back above this logarithm of exit speed over entry speed [1]."""

    # Regular motion
    large_counts: float = 10.0
    """A motion is probed from this amplitude on: the threshold [counts]."""
    large_rad: float = 0.01745
    """The same without counts [rad]"""
    small_counts: float = 3.0
    """A steady motion is probed from this amplitude on: an encoder keeps up one or two counts by
    its steps alone [counts]."""
    small_rad: float = 0.005
    """The same without counts [rad]"""
    kept: float = 0.98
    """A motion that goes on keeps this fraction of its amplitude over a cycle [1]."""
    regular_period: float = 0.12
    """The logarithm of the ratio of its durations a cycle apart is below this [1]."""
    regular: int = 2
    """A motion is regular after so many such half-cycles in a row [1]."""
    loss: float = 0.01
    """A regular motion dies by itself if it loses more than this fraction a cycle [1]: with half of
    it one that faded into a limit cycle was found 5 s late"""
    loss_counts: float = 0.45
    """and more than this in all: two mean amplitudes are off by 0.25 together [counts]"""
    loss_half_cycles: int = 6
    """within at most so many half-cycles. Below two thresholds it is regular after so many, because
    rounding hides a slow decay [1]."""
    least_gain: float = -0.05
    """Contacts die by themselves if the logarithm of exit over entry speed is below this [1]."""
    throws: int = 3
    """So many contacts in a row that throw the shaft back are probed [1]: without it one of four
    walls that oscillate under a steady push was found 0.4 s late."""
    steady: int = 40
    """No hand makes so many half-cycles in a row so evenly [1]:"""
    steady_amplitude: float = 0.02
    """amplitudes differ from the first one by at most this fraction [1]"""
    steady_counts: float = 0.6
    """or this much, the rounding of two turning points [counts];"""
    steady_duration: float = 0.03
    """durations by at most this fraction [1]"""
    steady_periods: float = 2.1
    """or so many periods, the rounding of two turning points [1]."""

    # Saturated motion
    saturated: float = 0.55
    """A motion saturates if its mean pull is above this fraction of the torque limit: a linear
    spring that just reaches it has 0.5 [1]."""
    saturated_inertia: float = 0.3
    """The logarithm of the ratio of its apparent inertias a cycle apart is below this [1]: of
    durations, 7 of 42 walls with 4 to 15 times the believed lag were found too late."""

    # Motion that goes on, although no half-cycle is like the one before
    goes_on: int = 16
    """It becomes no smaller over so many half-cycles, an even number [1]. If all are too fast for a
    hand it is suspect: at 70 Hz rounding makes durations and amplitudes irregular."""

    # Motions of several axes: they beat, so that they are probed if they go on,
    beating_far: float = 1.5
    """their turning points' mean is at this times what saturates the torque [1]: without it one of
    64 arms that oscillate was never found,"""
    beating_pull: float = 0.1
    """and the mean pull is above this fraction of the limit: not in a law's free range [1]."""

    # Motion beyond hands
    hands_hz: float = 15.0
    """No hand moves a shaft to and fro by a degree faster than this [Hz]."""
    hands_acceleration: float = 700.0
    """No hand turns a shaft around with more: 0.5 rad at 6 Hz, 0.1 rad at 13 Hz [rad/s²]."""
    hands_power: float = 40.0 * 7.0**3
    """No hand gives more power than this over the cube of the frequency: 40 W at 7 Hz, 14 W at
    10 Hz; measured were up to 23 W at 7 Hz in thirty hours [W·Hz³]."""

    # Motion that the believed servo makes
    lightest: float = 0.65
    """The servo may have an apparent inertia from this ratio to the least believed one on [1]"""
    heaviest: float = 1.6
    """up to this ratio to the largest believed one: friction and lag change it [1]."""
    grows: float = 0.4
    """Its motion is an early alarm if its amplitude's logarithm grows by this [1]"""
    grows_half_cycles: int = 3
    """over at least so many half-cycles [1],"""
    grows_evenly: float = 0.6
    """each by this fraction of the mean: a hand's motion grows and then stays [1],"""
    grows_counts: float = 8.0
    """from this amplitude on: a step of the encoder is an eighth of it [counts]."""

    # A probe, and its answer
    scale: float = 0.25
    """Elastic torque, its limit and damping are scaled by this in a probe, and again in each step
    of the reduction: a linear period doubles [1]."""
    first: float = 1.05
    """The wall's first half-cycle in a probe is longer than this [1],"""
    second: float = 1.40
    """the second one longer than this [1],"""
    both: float = 2.6
    """their sum longer than this [1]."""
    grown: float = 1.3
    """Above this amplitude a motion has grown: a hand meets less resistance [1]."""
    explained: float = 0.78
    """A motion that has not grown has saturated the torque if its apparent inertia is above this:
    what a hand moves seems two or three times as light [1]."""
    explained_each: float = 1.1
    """Then either half-cycle is longer than this [1],"""
    explained_both: float = 2.4
    """and their sum longer than this [1]."""
    contact: float = 1.6
    """At a one-sided wall either contact is longer than this [1],"""
    contacts: float = 3.5
    """and their sum longer than this [1]."""
    largest: float = 3.2
    """A longer second half-cycle, or a larger amplitude, is another motion's [1],"""
    largest_contact: float = 6.0
    """of contacts above this: a push from outside [1]."""
    lightest_probed: float = 0.5
    """The torque explains a motion if its apparent inertia is above this [1]"""
    heaviest_probed: float = 1.6
    """and below this [1],"""
    heaviest_contact: float = 2.5
    """of contacts below this [1]."""
    collapsed: float = 0.6
    """A motion has stopped in the probe if its amplitude is below this [1],"""
    quicker: float = 0.8
    """unless its first half-cycle is shorter than this: no wall makes a motion quicker by giving
    way [1]."""
    again_s: float = 5.0
    """A motion that stopped in a probe is the wall's if it comes back within this time [s],"""
    same_period: float = 0.1
    """with the logarithm of the ratio of the periods below this [1]"""
    same_amplitude: float = 0.5
    """and that of the amplitudes below this [1],"""
    stops: int = 3
    """or, whatever the motion, after so many stops: a load changes its period [1]."""
    held_off_s: float = 10.0
    """A motion like the one that a hand made is not probed again for this time [s]:"""
    other_period: float = 0.25
    """the logarithm of the ratio of the periods is below this [1],"""
    other_amplitude: float = 1.6
    """and the amplitude below this ratio [1]."""

    # A load that forbids a probe
    loaded: float = 0.6
    """A motion with a mean torque above this fraction of the limit is not probed [1],"""
    loaded_contacts: float = 0.24
    """of contacts above this, just below the scale of the probe: they hold no load [1]."""
    regular_long: int = 20
    """So many regular half-cycles end the run there; a hand's motion is probed again after so
    many [1]."""

    # After an alarm
    steps: int = 3
    """The reduction has so many steps: K goes to a quarter, a sixteenth, a 64th [1]."""
    dying: float = 0.95
    """A motion dies if its amplitude is below this fraction of that a cycle before [1]."""
    cycles: float = 5.4
    """A motion ends the run after so many cycles of the slowest motion that K allows: the page
    promises six, and a half-cycle must end before [1],"""
    longest_s: float = 4.5
    """or after this time; the page promises five [s]."""
    reduced_half_cycles: int = 4
    """It ends the run after so many half-cycles on one wall at least [1]."""
    reduced_gain: float = 0.1
    """Contacts with a reduced wall end the run above this logarithm of exit over entry speed
    [1]."""
    rest_between: float = 4.0
    """The wall comes back at so many times the torque if the spring passed its rest between two
    samples [1]."""
    rest_counts: float = 2.0
    """The spring is at rest within so much, however stiff it is [counts]."""

    # A load that is held while the wall is softer
    hold_least: float = 0.05
    """A load below this fraction of the torque limit is not held [1]."""
    hold_room: float = 0.25
    """It is held up to this fraction of the amplitude beyond the turning points [1]."""
    hold_settled: float = 1.5
    """The wall's torque is the load's if no turning point has come for so many half-cycles [1]"""
    hold_rests_s: float = 0.075
    """and the shaft has rested for this time over the root of the spring's scale [s]."""
    hold_slack: float = 0.1
    """On a wall that stays reduced, what is held follows where the spring about it carries more
    than this fraction of its limit [1],"""
    hold_follows_s: float = 0.5
    """with this time constant [s]."""


TUNING: Final = Tuning()
