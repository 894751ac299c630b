"""Decides what a motion on the whole wall calls for, from the motion alone; keeps no state."""

from __future__ import annotations

from enum import IntEnum

from haptic_wall.controller.detector.regularity import Regularity, beyond_hands, saturates
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.tuning import TUNING


class Suspicion(IntEnum):
    """The reaction that a motion calls for."""

    NONE = 0
    """It decays, or no wall makes it."""
    WAIT = 1
    """It may be the wall's, but no probe can show that now."""
    PROBE = 2
    """A probe shows whether the wall makes it."""
    ALARM = 3
    """The wall makes it: no hand can."""
    END = 4
    """As before, and a softer wall would give way to its load: the run must end."""


def suspected(seen: Regularity, settings: WatchSettings) -> bool:
    """Whether a motion does not decay, and is regular, saturates the torque, or is too fast."""
    regular = seen.steady
    if seen.size >= settings.threshold:
        last = seen.motion.last
        regular = seen.repeats or saturates(last, settings.torque_limit) or seen.races
    return regular and seen.motion.gain > TUNING.least_gain


def suspicion(
    seen: Regularity,
    settings: WatchSettings,
    *,
    amplitude: float,
    loaded: bool,
    like_hand: bool,
    held_off: bool,
    regular: bool,
    alone: bool,
) -> Suspicion:
    """Return what a suspected motion calls for.

    Args:
        seen: The motion.
        settings: Those of the watch.
        amplitude: Mean of the last two half-cycles [rad].
        loaded: Its load would push through a softer wall.
        like_hand: The last hand that a probe found moved the shaft like this.
        held_off: That was not long ago.
        regular: It is; else motions of several axes beat.
        alone: The run has no other axis. A hand at the tip of an arm moves a joint faster than it
            could move it alone.
    """
    large = amplitude >= settings.threshold
    sure = alone and regular and seen.size >= settings.threshold and not seen.contacts
    if sure and beyond_hands(seen.motion.last):
        return Suspicion.END if settings.acts and loaded else Suspicion.ALARM
    if not settings.acts:
        return Suspicion.WAIT
    if loaded:
        long = seen.steady or seen.streak >= TUNING.regular_long
        return Suspicion.END if large and long else Suspicion.WAIT
    if seen.steady and like_hand and large:
        return Suspicion.ALARM  # a probe took it for a hand's; no hand is so regular
    if seen.nearly_steady:
        return Suspicion.WAIT
    if held_off and like_hand:  # a hand seldom goes on so regularly
        again = seen.streak and seen.streak % TUNING.regular_long == 0
        return Suspicion.PROBE if again else Suspicion.WAIT
    return Suspicion.PROBE
