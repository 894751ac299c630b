"""Plans the motions that show a vibration mode: steady travel with a swept sine torque added.

While the shaft keeps its direction friction is a constant, so that all else is linear. Nothing is
fed back: a spring or a damper could drive the vibration that is looked for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from haptic_wall.controller.experiments.identify.excitation import Bounds, Guess, undamped_home
from haptic_wall.controller.experiments.identify.fitting import Fit
from haptic_wall.controller.laws.program import Phase

SPEED = 1.5
"""Largest speed of a cruise [rad/s]"""
LONGEST_S, SHORTEST_S = 0.5, 0.12
"""Of a cruise"""
TURN_S = 0.06
"""Default of ``Cruise.turn``"""
SHARE = 0.6
"""Largest fraction of the torque limit"""
BANDS = ((6.0, 12.0), (10.0, 22.0), (18.0, 45.0), (40.0, 95.0), (85.0, 140.0), (130.0, 200.0))
"""Ranges of the frequency, in hertz; each both ways"""
_OF_SPEED = 0.3
"""Speed that a rigid shaft has by the sweep at its lowest frequency, over the cruise's"""
_PER_HOLD = 2
"""Bands between two returns to the start"""


@dataclass(frozen=True, slots=True)
class Band:
    """The torque's frequencies during a cruise each way."""

    from_hz: float
    to_hz: float
    torque: float
    """Amplitude, before the limit of the torque [N·m]"""


@dataclass(frozen=True, slots=True)
class Cruise:
    """How a servo cruises."""

    speed: float
    """[rad/s]"""
    half: float
    """Half the way [rad]"""
    seconds: float
    """Of a cruise"""
    bias: float
    """Torque that keeps the speed [N·m]"""
    inertia: float
    """[kg·m²]"""
    most: float
    """Largest torque [N·m]"""
    turn: float = TURN_S
    """In which the shaft is turned around, at least [s]"""


def cruise_of(fit: Fit, bounds: Bounds, amplitude: float) -> Cruise:
    """Return how a fitted servo cruises, as far as ``amplitude`` to each side [rad]."""
    speed = min(SPEED, bounds.speed, 2.0 * amplitude / SHORTEST_S)
    effects = fit.effects
    bias = fit.coulomb + max(fit.damping, 0.0) * speed + effects.drag * speed**2
    if effects.fading > 0.0:
        bias += effects.excess * math.exp(-speed / effects.fading)
    bias = bias / (1.0 - min(max(effects.gear, 0.0), 0.5)) + max(effects.dead_band, 0.0)
    seconds = min(2.0 * amplitude / speed, LONGEST_S)
    half = min(amplitude, 0.5 * speed * seconds)
    return Cruise(speed, half, seconds, bias, fit.inertia, SHARE * bounds.torque)


def survey(cruise: Cruise) -> list[Band]:
    """Return the bands in which a mode is looked for."""
    return [
        Band(low, high, _OF_SPEED * cruise.speed * cruise.inertia * math.tau * low)
        for low, high in BANDS
    ]


def cruises(cruise: Cruise, bands: Sequence[Band], guess: Guess, bounds: Bounds) -> list[Phase]:
    """Return the program: each band on the way there and on the way back.

    Args:
        cruise: Cruise of the servo.
        bands: At least one band.
        guess: Parameters for the spring that brings the shaft back to its start.
        bounds: Limits.
    """
    return _there_and_back(cruise, [_swept(cruise, band) for band in bands], guess, bounds)


def _swept(cruise: Cruise, band: Band) -> Phase:
    return Phase(
        cruise.seconds,
        torque=max(min(band.torque, cruise.most - cruise.bias), 0.1 * cruise.bias),
        bias=cruise.bias,
        wave="sine",
        from_hz=band.from_hz,
        to_hz=band.to_hz,
    )


def _there_and_back(
    cruise: Cruise, ways: Sequence[Phase], guess: Guess, bounds: Bounds
) -> list[Phase]:
    """Return a program that cruises there and back with each phase, given for the way there.

    A constant torque beside holds the weight.
    """
    held = guess.cosine
    home = undamped_home(guess, bounds)
    impulse = cruise.inertia * 2.0 * cruise.speed
    seconds = max(cruise.turn, impulse / max(cruise.most - cruise.bias, 0.1 * cruise.most))
    turn, reach = impulse / seconds, 4.0 * cruise.half
    phases: list[Phase] = []
    for number, there in enumerate(ways):
        if number % _PER_HOLD == 0:
            phases += [
                home,
                Phase(seconds, torque=-0.5 * turn - cruise.bias, bias=held, reach=reach),
                Phase(cruise.half / cruise.speed, torque=-cruise.bias, bias=held, reach=reach),
            ]
        for way in (1.0, -1.0):
            phases += [
                Phase(seconds, torque=way * turn, bias=held, reach=reach),
                replace(
                    there,
                    bias=way * there.bias + held,
                    center=-way * cruise.half,
                    reach=2.0 * cruise.half,
                ),
            ]
    return [*phases, home]
