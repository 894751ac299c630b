"""How much softer an oscillating wall is best made, and when: what leaves the least motion.

At a turn the spring holds all the energy, and a softer spring keeps less of it; in the middle the
motion holds it, and swings further against a softer spring. A small step leaves growth, a large
one at the wrong moment a large swing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from controller.detector.oscillation import DetectorSettings

SHARES = (0.8, 0.7, 0.6, 0.5, 0.42, 0.35, 0.3, 0.25, 0.2)
"""What a step may leave of the stiffness"""
UNKNOWN = 0.5
"""What it leaves where the servo's friction is not known, at once"""
_AHEAD = 2.0
"""Half cycles on the softer spring over which a step is judged"""
_UNSURE = 0.04
"""Part of the energy that may be in the motion at a turn: frequency and delay are believed"""
_NEAR = 0.02
"""So near to the best moment is as good [1]"""
_MOST = 50.0
"""Exponent beyond which growth is endless"""


@dataclass(frozen=True, slots=True)
class Swing:
    """The oscillation as it is now."""

    growth: float
    """[1/s]"""
    frequency_hz: float
    amplitude: float
    """[rad]"""
    past_s: float
    """How long after the last turn a softer spring would act [s]"""


def softer(
    swing: Swing, servo: DetectorSettings, stiffness: float, damping: float, delay_s: float
) -> float | None:
    """Share of the stiffness to go to now; None: less motion is left by a step at the next turn.

    An oscillation that grows at s has ``K (T/2 + t_d) = B + b + 2 m s``, with Coulomb friction's
    ``4 c / (pi A w)`` in b; the left side goes with the share of K, and the growth with it. Before
    a whole swing has shown the growth it is thought to be at least what is believed. What acts at
    an angle past the turn finds a part sin² of the energy in the motion. While one waits, the
    motion grows.

    Args:
        swing: What the detector sees.
        servo: What is believed of it.
        stiffness: K in force [N·m/rad].
        damping: Virtual damping B in force [N·m·s/rad].
        delay_s: t_d, believed [s].

    Source: Gil et al., ICRA 2007, eq. (8), with the growth of m x'' + c x' + K x = 0.
    """
    growth, hertz = swing.growth, swing.frequency_hz
    if not (hertz > 0.0 and servo.damping >= 0.0 and servo.inertia > 0.0):
        return UNKNOWN
    taking = servo.damping + max(damping, 0.0)
    if servo.coulomb > 0.0 and swing.amplitude > 0.0:
        taking += 2.0 * servo.coulomb / (math.pi**2 * swing.amplitude * hertz)
    taken = taking / (2.0 * servo.inertia)
    believed = stiffness * (0.5 * servo.period + delay_s) / (2.0 * servo.inertia) - taken
    growth = max(growth, believed) if growth > 0.0 else believed
    if not growth > 0.0:
        return UNKNOWN
    half_s = 0.5 / hertz
    past = swing.past_s % half_s / half_s
    sine = min(math.sin(math.pi * past) ** 2 + _UNSURE, 1.0)
    best, now, later = UNKNOWN, math.inf, math.inf
    for share in SHARES:
        left = max(growth - (1.0 - share) * (growth + taken), 0.0)
        grown = math.exp(min(left * _AHEAD * half_s / math.sqrt(share), _MOST))
        motion = math.sqrt(1.0 - sine + sine / share) * grown
        if motion < now:
            best, now = share, motion
        later = min(later, math.sqrt(1.0 - _UNSURE + _UNSURE / share) * grown)
    waiting = math.exp(min(growth * half_s * (1.0 - past), _MOST)) * later
    return best if now <= waiting + _NEAR else None
