"""Moves a servo to find its vibration mode: sweeps all frequencies, then those near the mode.

An encoder on the output does not see the ratio of the two masses: to both together the motion is
the same whatever the load's share. Bounds of that ratio come from what was believed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from haptic_wall.controller.experiments.identify.bench import Bench
from haptic_wall.controller.experiments.identify.cruise import (
    Band,
    Cruise,
    cruise_of,
    cruises,
    survey,
)
from haptic_wall.controller.experiments.identify.excitation import Bounds
from haptic_wall.controller.experiments.identify.fitting import Fit
from haptic_wall.controller.experiments.identify.mode import Mode, closer, looked_at, one_way
from haptic_wall.controller.experiments.identify.mode_fit import (
    FEWEST,
    Cruises,
    ModeModel,
    cruises_of,
    joined,
)
from haptic_wall.controller.experiments.identify.motion import motion_of

FEWEST_CRUISES = 6
"""Least number that tells something"""
_NEAR = 0.15
"""Relative distance from a mode's frequency over which a closer look sweeps"""
_REPEATS = 4
_OF_SPEED = 0.55
"""Speed of all vibration in a closer look, over the cruise's"""
_AHEAD = 0.07
"""Slowest speed of the motor that counts as ahead, over the cruise's"""


def find_mode(
    bench: Bench, fit: Fit, bounds: Bounds, amplitude: float, encoder: str, load_ratio: float
) -> Mode | None:
    """Return the vibration mode of a fitted servo, or its absence.

    Args:
        bench: The servo.
        fit: Fit of its other motions.
        bounds: Limits of the motions.
        amplitude: Wanted excursion to each side [rad].
        encoder: Side of the transmission that it measures.
        load_ratio: Largest believed load over motor inertia.

    Returns:
        None: the cruises were too short to tell anything.
    """
    cruise = cruise_of(fit, bounds, amplitude)
    every = _cruised("mode", bench, fit, bounds, cruise, survey(cruise))
    if every is None:
        return None
    mode = looked_at(ModeModel(every, encoder, fit.inertia))
    if mode.hertz is None:
        return mode
    steady, bands = _closer_look(mode, mode.hertz, cruise, load_ratio)
    near = _cruised("mode-closer", bench, fit, bounds, steady, bands)
    if near is None:
        return mode
    seen = closer(ModeModel(near, encoder, fit.inertia), mode)
    model = ModeModel(joined(every, near), encoder, fit.inertia)
    kept = one_way(model, seen, load_ratio, _AHEAD * cruise.speed)
    return closer(ModeModel(kept, encoder, fit.inertia), seen)


def _closer_look(
    mode: Mode, hertz: float, cruise: Cruise, load_ratio: float
) -> tuple[Cruise, list[Band]]:
    """Return cruises in which neither side turns back, about a mode's frequency.

    The shaft is turned around within whole periods of the vibration, which leaves it at rest.
    """
    w = math.tau * hertz
    low, high = (1.0 - _NEAR) * hertz, (1.0 + _NEAR) * hertz
    rate = math.tau * (high - low) / cruise.seconds
    felt = min(0.5 * math.sqrt(math.tau / rate), 0.5 / (mode.ratio * w))
    per_torque = (1.0 / w + max(1.0, load_ratio) * felt) / mode.inertia
    turn = math.ceil(cruise.turn * hertz) / hertz
    torque = _OF_SPEED * cruise.speed / per_torque
    return replace(cruise, turn=turn, inertia=mode.inertia), [Band(low, high, torque)] * _REPEATS


def _cruised(
    name: str, bench: Bench, fit: Fit, bounds: Bounds, cruise: Cruise, bands: Sequence[Band]
) -> Cruises | None:
    """Return the cruises over some bands; None: they are too few or too short."""
    phases = cruises(cruise, bands, bench.corrected(fit), bounds)
    played = bench.play(name, phases)
    motion = motion_of(played.rows)
    rows = played.rows[played.rows["sampled_ns"] > 0]
    spans = []
    for number, phase in enumerate(phases):
        sampled = (rows["sampled_ns"][rows["phase"] == number] - rows["sampled_ns"][0]) * 1e-9
        if phase.wave == "sine" and sampled.size > FEWEST:
            spans.append((float(sampled[0]), float(sampled[-1]), -float(np.sign(phase.center))))
    decay = max(fit.damping, 0.0) / fit.inertia
    found = cruises_of(motion, spans, bounds.period, max(fit.delay, 0.0), decay, fit.effects)
    return found if found.way.size >= FEWEST_CRUISES else None
