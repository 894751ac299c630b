"""Checks each reading against the safety limits, and whether the wall drives the shaft too fast.

A servo alone reaches at most its no-load speed, and comes near it only where its torque follows the
motion for long. Speed alone does not distinguish that from a hand: a hand that jerks the shaft out
of the wall, or releases it, gets back the energy it has put in. So the energy decides too: the
shaft moves with more than the wall had taken before.

Source: energy count after Hannaford and Ryu, IEEE T-RA 18(1), 2002.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from math import isfinite, isnan
from typing import Final, Literal

from haptic_wall.controller.laws.wall import Law
from haptic_wall.controller.milliseconds import ms
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.settings.shares import DRIVEN_SHARE
from haptic_wall.hw.servo import JUMP_SPEED, Facts, Outcome

LEAST_FAILED: Final = 3
"""Consecutive failed readings that a silence needs to trip: at low rates the allowed time is over
after one or two, and a stall of the loop itself is no fault of the bus [1]"""
REFUSALS: Final = 3
"""Largest number of consecutive readings refused for their speed. A persistent jump is no hiccup of
the bus: the next one trips."""
MISSED_S: Final = 0.5
"""Time over which missed periods are counted [s]; at low rates it is that of ten periods"""
Refused = Literal[Outcome.REFUSED]
_REFUSED: Final = Outcome.REFUSED
_WINDOW_NS: Final = 10_000_000
"""Least time over which the speed of a driven motion is measured [ns]. One count a tick is 1.53
rad/s at 4096 counts and 1 kHz; the two counts of tolerance are 0.31 rad/s over this time."""
_SLACK_COUNTS: Final = 2.0
_OWN_SHARE: Final = 0.5
"""Fraction of the shaft's kinetic energy that must come from the wall to trip"""


def speed_limits(max_speed: float | None, facts: Facts, real: bool) -> tuple[float, float]:
    """Return the largest speed of any motion, and of one that the torque drives [rad/s].

    Args:
        max_speed: ``safety.max_speed`` [rad/s], used for both; None: from the no-load speed.
        facts: The servo's.
        real: It may be a real servo. A simulated one has no back-EMF that limits it: a kick makes
            it faster than any real one.

    Returns:
        The second is inf where there is no limit: the no-load speed is not known.
    """
    if max_speed is not None:
        return max_speed, max_speed
    return facts.fastest if real else JUMP_SPEED, DRIVEN_SHARE * facts.no_load_speed or math.inf


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """The limits whose violation trips, and the lower bounds of the body, in commanded units."""

    max_speed: float
    """Of any motion [rad/s]"""
    position_step: float
    """Encoder step, the tolerance of a reading [rad]"""
    max_loss: float
    """Fraction of failed readings in the window [1]"""
    loss_window: int
    """Readings in the window"""
    max_silence_ns: int
    """Time without a good reading [ns]; fewer than ``LEAST_FAILED`` failed ones never trip"""
    period_ns: int
    """Of the grid [ns]"""
    refusals: int = 0
    """Consecutive readings that may be refused for their speed before it trips"""
    max_missed: float = math.inf
    """Fraction of the last periods that may have no tick [1]; inf: any"""
    travel: tuple[float, float] = (-math.inf, math.inf)
    """Lowest and highest position [rad]"""
    travel_from_start: bool = False
    """``travel`` counts from the first reading"""
    driven_speed: float = math.inf
    """Of a motion that the torque drives [rad/s]"""
    torque_limit: float = math.inf
    """[N·m]"""
    inertia: float = 0.0
    """[kg·m²]"""
    damping: float = 0.0
    """Viscous friction [N·m·s/rad]"""
    coulomb: float = 0.0
    """Coulomb friction [N·m]"""
    kicked: bool = False
    """The initial energy in the spring is intended: a kick"""


class Safety:
    """Checks readings and torques against the limits; O(1) a tick.

    Args:
        limits: The limits.

    Attributes:
        found: The value that tripped, and its limit, for people; empty: none.
        refused: Number of readings refused: broken replies that look valid.
        worst_missed: Largest fraction of the periods of half a second without a tick [1].
    """

    def __init__(self, limits: SafetyLimits) -> None:
        self.found = ""
        self._limits = limits
        self._window = bytearray(limits.loss_window)
        self._at = 0
        self._failed = 0
        self._in_row = self._refused = self.refused = 0
        self._heard_ns: int | None = None
        self._gaps: deque[tuple[int, int]] = deque()
        self._missed = 0
        self.worst_missed = 0.0
        self._position = self._moved = math.nan
        self._sampled_ns = self._elapsed_ns = 0
        self._low, self._high = limits.travel
        self._driving = False
        """The torque follows the motion, since a position [rad] and an instant [ns]:"""
        self._since = 0.0
        self._since_ns = 0
        self._holding = False
        """The wall is softer, and holds a load"""
        self._given = math.nan
        """Work of the torque less friction's, not below the negative energy in the spring [J]"""

    def good(self, position: float, sampled_ns: int, alert: bool) -> Trip | Refused | None:
        """Judge a valid reply: its position, and its distance from the last one.

        Args:
            position: [rad]
            sampled_ns: Its instant [ns].
            alert: The servo has latched a hardware error.

        Returns:
            None: it is good; ``Outcome.REFUSED``: a position that the shaft cannot have reached,
            not to be used; or the trip.
        """
        limits = self._limits
        moved, elapsed_ns = position - self._position, sampled_ns - self._sampled_ns
        way = moved if moved >= 0.0 else -moved  # NaN the first time: compares false
        too_far = way > limits.max_speed * (elapsed_ns * 1e-9) + 2.0 * limits.position_step
        if too_far and self._refused < limits.refusals:
            self._refused += 1
            self.refused += 1
            return _REFUSED
        self._refused = 0
        if self._failed:  # else the window holds no failure that could leave it
            self._count(0)
        self._in_row = 0
        if not isfinite(position):
            return Trip.NOT_A_NUMBER
        if alert:
            return Trip.HARDWARE_ERROR
        if limits.travel_from_start and isnan(moved):
            self._low += position
            self._high += position
        self._moved, self._elapsed_ns = moved, elapsed_ns
        self._position = position
        self._sampled_ns = self._heard_ns = sampled_ns
        if too_far:
            speed = way / (elapsed_ns * 1e-9) if elapsed_ns else math.inf
            self.found = (
                f"{speed:.3g} rad/s between two readings; at most {limits.max_speed:.3g} is allowed"
            )
            return Trip.OVERSPEED
        if position < self._low or position > self._high:
            self.found = f"{position:.4g} rad; allowed is {self._low:.4g} to {self._high:.4g}"
            return Trip.TRAVEL
        return None

    def failed(self, now_ns: int) -> Trip | None:
        """Count a failed reading, and judge the time since the last good sample.

        Args:
            now_ns: When it failed [ns], on the clock of the readings.
        """
        self._count(1)
        self._in_row += 1
        if self._heard_ns is None:  # no good reading so far: the time counts from here
            self._heard_ns = now_ns
        limits, silence_ns = self._limits, now_ns - self._heard_ns
        if self._in_row >= LEAST_FAILED and silence_ns > limits.max_silence_ns:
            most = ms(limits.max_silence_ns * 1e-9)
            self.found = f"{ms(silence_ns * 1e-9)} without a reading; at most {most} is allowed"
            return Trip.LOSSES_IN_ROW
        if self._failed > limits.max_loss * limits.loss_window:
            share = self._failed / limits.loss_window
            self.found = f"{share:.1%} of the readings; at most {limits.max_loss:.1%} is allowed"
            return Trip.LOSS_RATE
        return None

    def missed(self, deadline_ns: int, periods: int) -> Trip | None:
        """Count periods without a tick, and judge those of the last half second.

        Args:
            deadline_ns: The deadline that was served after them [ns].
            periods: Number of missed periods.
        """
        limits, gaps = self._limits, self._gaps
        window_ns = max(round(MISSED_S * 1e9), 10 * limits.period_ns)
        gaps.append((deadline_ns, periods))
        self._missed += periods
        while gaps[0][0] <= deadline_ns - window_ns:
            self._missed -= gaps.popleft()[1]
        share = min(self._missed / (window_ns / limits.period_ns), 1.0)
        self.worst_missed = max(self.worst_missed, share)
        if share <= limits.max_missed:
            return None
        self.found = (
            f"{share:.1%} of the periods of {MISSED_S:g} s; at most {limits.max_missed:.0%} is"
            " allowed"
        )
        return Trip.MISSED_PERIODS

    def _count(self, failed: int) -> None:
        window = self._window
        self._failed += failed - window[self._at]
        window[self._at] = failed
        self._at = (self._at + 1) % len(window)

    def driven(self, torque: float, contact: bool, law: Law) -> bool:
        """Return whether the torque has driven the shaft too fast up to the last good reading.

        The mean speed over 10 ms keeps the tolerance for the encoder's steps small. A sample in
        which the torque is zero, or opposes the motion, ends a driven motion. The wall may return
        what it has taken: at most the energy in its spring. Anything beyond that and beyond
        friction comes from the wall itself. Outside a one-sided wall the count restarts. A program
        of an experiment drives the shaft on purpose; there speed alone decides.

        Args:
            torque: Commanded torque that acted since the reading before [N·m].
            contact: Whether the law acts at this position.
            law: The rendered law.
        """
        moved = self._moved
        if moved == 0.0:
            if not self._driving:
                return False
        elif law.guarded:
            if isnan(self._given):  # the first sample of the wall
                kicked = contact and self._limits.kicked
                self._given = -self._held(law) if kicked else 0.0
                return False
            if contact or torque != 0.0:
                self._count_energy(torque, contact, law)
            else:
                self._given = 0.0
        if torque == 0.0 or not moved * torque >= 0.0:
            self._driving = False
            return False
        return self._too_fast(law.guarded)

    def _too_fast(self, guarded: bool) -> bool:
        """Judge the mean speed since the torque follows the motion, or since it was slow."""
        limits, position, sampled_ns = self._limits, self._position, self._sampled_ns
        if not self._driving:
            self._driving = True
            self._since, self._since_ns = position - self._moved, sampled_ns - self._elapsed_ns
        elapsed_ns = sampled_ns - self._since_ns
        if elapsed_ns < _WINDOW_NS:
            return False
        way, elapsed = abs(position - self._since), elapsed_ns * 1e-9
        if not way > limits.driven_speed * elapsed + _SLACK_COUNTS * limits.position_step:
            self._since, self._since_ns = position, sampled_ns
            return False
        speed = way / elapsed
        if guarded and not self._given > 0.5 * _OWN_SHARE * limits.inertia * speed * speed:
            return False
        self.found = (
            f"{speed:.3g} rad/s for {_WINDOW_NS * 1e-6:g} ms, driven by the torque; at most"
            f" {limits.driven_speed:.3g} is allowed"
        )
        return True

    def _count_energy(self, torque: float, contact: bool, law: Law) -> None:
        """Count the work that the torque did between the last two readings."""
        limits, moved = self._limits, self._moved
        way = abs(moved)
        speed = way / ((self._elapsed_ns or 1) * 1e-9)
        given = self._given + moved * torque - (limits.coulomb + limits.damping * speed) * way
        if self._holding != (law.derating.carried != 0.0):
            self._holding = not self._holding
            if not self._holding and contact:  # the load has loaded the whole spring
                given = min(given, -self._held(law))
        if given < 0.0:
            given = max(given, -self._held(law)) if contact else 0.0
        self._given = given

    def _held(self, law: Law) -> float:
        """Return the energy in the limited spring, and in what holds a load [J]."""
        position, limit = self._position, min(law.clip, self._limits.torque_limit)
        held = abs(law.held * (position - law.position)) if law.held else 0.0
        return held + law.stored(position, limit)
