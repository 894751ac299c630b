"""Detects overspeed that the wall's torque causes, as opposed to a hand that moves the shaft.

A servo alone reaches at most its no-load speed, and comes near it only where its torque follows the
motion for long. Speed alone does not distinguish that from a hand: a hand that jerks the shaft out
of the wall, or releases it, gets back the energy it has put in. So the energy decides too: the
shaft moves with more than the wall had taken before.

Source: energy count after Hannaford and Ryu, IEEE T-RA 18(1), 2002.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from math import isnan
from typing import Final

from haptic_wall.controller.laws.wall import Law
from haptic_wall.controller.settings.shares import DRIVEN_SHARE
from haptic_wall.hw.servo import JUMP_SPEED, Facts

WINDOW_S: Final = 0.01
"""Time over which that speed is measured [s]. One count a tick is 1.53 rad/s at 4096 counts and 1
kHz; the two counts of tolerance are 0.31 rad/s over this time."""
_WINDOW_NS: Final = round(WINDOW_S * 1e9)
SLACK_COUNTS: Final = 2.0
OWN_SHARE: Final = 0.5
"""Fraction of the shaft's kinetic energy that must come from the wall to trip"""
_KEPT: Final = 128
"""Number of stored samples: the window's at the highest rate, 10 kHz, and some more"""


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
class DrivenLimits:
    """Largest speed, and the lower bounds of the believed body, in commanded units."""

    speed: float
    """[rad/s]; inf: no limit"""
    position_step: float = 0.0
    """Encoder count [rad]; 0: not quantised"""
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


class DrivenSpeed:
    """Judges the mean speed over 10 ms of torque along the motion, and the source of its energy.

    The mean over several samples keeps the tolerance for the encoder's steps small. A sample in
    which the torque is zero, or opposes the motion, starts a new window.

    The wall may return what it has taken: at most the energy in its spring. Anything beyond that
    and beyond friction comes from the wall itself. Outside a one-sided wall the count restarts. A
    program of an experiment drives the shaft on purpose; there speed alone decides.

    Attributes:
        found: The excessive speed, and the highest allowed [rad/s]; empty: none was found.
    """

    __slots__ = (
        "_at",
        "_coulomb",
        "_count",
        "_damping",
        "_given",
        "_holding",
        "_instants_ns",
        "_kicked",
        "_own",
        "_position",
        "_positions",
        "_sampled_ns",
        "_slack",
        "_speed",
        "_torque_limit",
        "found",
    )

    def __init__(self, limits: DrivenLimits) -> None:
        self.found: tuple[float, ...] = ()
        self._speed = limits.speed * 1e-9
        self._slack = SLACK_COUNTS * limits.position_step
        self._own = 0.5 * OWN_SHARE * limits.inertia
        self._torque_limit = limits.torque_limit
        self._damping = limits.damping * 1e9
        self._coulomb = limits.coulomb
        self._kicked = limits.kicked
        self._position = math.nan
        self._sampled_ns = 0
        self._positions = [0.0] * _KEPT
        self._instants_ns = [0] * _KEPT
        self._at = 0
        """Index of the last sample in the window"""
        self._count = 0
        """Number of intervals in the window"""
        self._holding = False
        """The wall is softer, and holds a load"""
        self._given = math.nan
        """Work of the torque less friction's, not below the negative energy in the spring [J]"""

    def too_fast(
        self, position: float, sampled_ns: int, torque: float, contact: bool, law: Law
    ) -> bool:
        """Take a sample; return whether the torque drove the shaft too fast in the whole window.

        Args:
            position: [rad]
            sampled_ns: Its instant [ns].
            torque: Commanded torque that acted since the last sample [N·m].
            contact: Whether the law acts at this position.
            law: The rendered law.
        """
        before, before_ns = self._position, self._sampled_ns
        moved = position - before
        self._position = position
        self._sampled_ns = sampled_ns
        if moved == 0.0:
            if self._count == 0:
                return False
        elif law.guarded:
            if isnan(moved):  # the first sample
                self._given = -self._held(position, law) if contact and self._kicked else 0.0
                return False
            if contact or torque != 0.0:
                way = moved if moved > 0.0 else -moved
                eaten = (self._coulomb + self._damping * way / (sampled_ns - before_ns or 1)) * way
                given = self._given + moved * torque - eaten
                if self._holding != (law.derating.carried != 0.0):
                    self._holding = not self._holding
                    if not self._holding and contact:  # the load has loaded the whole spring
                        given = min(given, -self._held(position, law))
                if given < 0.0:
                    held = self._held(position, law) if contact else 0.0
                    given = max(given, -held)
                self._given = given
            else:
                self._given = 0.0
        if torque == 0.0 or not moved * torque >= 0.0:
            self._count = 0
            return False
        return self._fast_over_the_window(before, before_ns, law.guarded)

    def _fast_over_the_window(self, before: float, before_ns: int, guarded: bool) -> bool:
        positions, instants_ns = self._positions, self._instants_ns
        position, sampled_ns = self._position, self._sampled_ns
        at, count = self._at, self._count
        if count == 0:
            positions[at], instants_ns[at] = before, before_ns
        self._at = at = (at + 1) % _KEPT
        positions[at], instants_ns[at] = position, sampled_ns
        count = count + 1 if count < _KEPT - 1 else count
        # The shortest window that is long enough.
        enough_ns = sampled_ns - _WINDOW_NS
        while count > 1 and instants_ns[at - count + 1] <= enough_ns:
            count -= 1
        self._count = count
        elapsed_ns = sampled_ns - instants_ns[at - count]
        if elapsed_ns < _WINDOW_NS:
            return False
        way = abs(position - positions[at - count])
        if not way > self._speed * elapsed_ns + self._slack:
            return False
        speed = way * 1e9 / elapsed_ns
        if guarded and not self._given > self._own * speed * speed:
            return False
        self.found = speed, self._speed * 1e9
        return True

    def _held(self, position: float, law: Law) -> float:
        """Return the energy in the limited spring, and in what holds a load [J]."""
        limit = min(law.clip, self._torque_limit)
        held = abs(law.held * (position - law.position)) if law.held else 0.0
        return held + law.stored(position, limit)
