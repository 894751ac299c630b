"""Plans the motions that show a vibration mode: steady travel with a swept sine torque added.

While the shaft keeps its direction friction is a constant, so that all else is linear. Nothing is
fed back: a spring or a damper could drive the vibration that is looked for.
"""

from __future__ import annotations

import math

from haptic_wall.controller.experiments.identify.excitation import Bounds, Guess, undamped_home
from haptic_wall.controller.experiments.identify.fit import Fit
from haptic_wall.controller.laws.program import Phase

SPEED = 1.5
"""Largest speed of a cruise [rad/s]"""
LONGEST_S, SHORTEST_S = 0.5, 0.12
"""Of a cruise"""
TURN_S = 0.06
"""In which the shaft is turned around, at least [s]"""
SHARE = 0.6
"""Largest fraction of the torque limit"""
BANDS = ((6.0, 12.0), (10.0, 22.0), (18.0, 45.0), (40.0, 95.0), (85.0, 140.0), (130.0, 200.0))
"""Ranges of the frequency, in hertz; each both ways"""
_OF_SPEED = 0.3
"""Speed that a rigid shaft has by the sweep at its lowest frequency, over the cruise's"""
_PER_HOLD = 2
"""Bands between two returns to the start"""


def cruises(fit: Fit, guess: Guess, bounds: Bounds, amplitude: float) -> list[Phase]:
    """Return the program: each band on the way there and on the way back.

    A constant torque beside holds the weight.

    Args:
        fit: Fit of the servo's other motions.
        guess: Its parameters, for the spring that brings the shaft back to its start.
        bounds: Limits.
        amplitude: Wanted excursion to each side [rad].
    """
    speed = min(SPEED, bounds.speed, 2.0 * amplitude / SHORTEST_S)
    drag = _drag(fit, speed)
    seconds = min(2.0 * amplitude / speed, LONGEST_S)
    half = min(amplitude, 0.5 * speed * seconds)
    most = SHARE * bounds.torque
    impulse = fit["inertia"] * 2.0 * speed
    turning = max(TURN_S, impulse / max(most - drag, 0.1 * most))
    turn, held, far = impulse / turning, guess.cosine, 4.0 * half
    home = undamped_home(guess, bounds)
    phases: list[Phase] = []
    for number, (low, high) in enumerate(BANDS):
        torque = _OF_SPEED * speed * fit["inertia"] * math.tau * low
        if number % _PER_HOLD == 0:
            phases += [
                home,
                Phase(turning, torque=-0.5 * turn - drag, bias=held, reach=far),
                Phase(half / speed, torque=-drag, bias=held, reach=far),
            ]
        for way in (1.0, -1.0):
            phases += [
                Phase(turning, torque=way * turn, bias=held, reach=far),
                Phase(
                    seconds,
                    torque=max(min(torque, most - drag), 0.1 * drag),
                    bias=way * drag + held,
                    center=-way * half,
                    wave="sine",
                    from_hz=low,
                    to_hz=high,
                    reach=2.0 * half,
                ),
            ]
    return [*phases, home]


def _drag(fit: Fit, speed: float) -> float:
    """Return the torque that keeps a speed [N·m]."""
    drag = fit["coulomb"] + max(fit["damping"], 0.0) * speed + fit["drag"] * speed**2
    if fit["fading"] > 0.0:
        drag += fit["excess"] * math.exp(-speed / fit["fading"])
    return drag / (1.0 - min(max(fit["gear"], 0.0), 0.5)) + max(fit["dead_band"], 0.0)
