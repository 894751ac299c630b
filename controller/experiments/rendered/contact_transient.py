"""Measures contacts with the rendered wall: depth, force, and returned speed.

A constant torque accelerates the shaft; it coasts into a one-sided wall, and out of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.experiments.holding import Hold
from haptic_wall.controller.experiments.identify.fitting import Fit
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.controller.theory.response import held_response
from haptic_wall.hw.servo import Outcome

START, REACH = 0.3, 0.5
"""Distance from the wall at the start, and at which a returned shaft is caught [rad]."""
DEEPEST = 0.25
"""Largest planned penetration [rad]"""
_SHARE = 0.5
"""Largest fraction of the torque limit for the spring, and of ``max_speed``"""
FASTEST = 2.0
"""Largest approach speed [rad/s]"""
_SPEEDS = (0.5, 1.0)
"""Fractions of the fastest approach"""
_REPEATS = 5
_COAST_S = 0.03
"""Time of coasting before the wall, in which the approach speed is measured [s]"""
_WINDOW_S = 0.03
"""Longest window for the speeds at the wall [s]"""
_FEWEST = 6
_CONTACT_S = 1.0


@dataclass(frozen=True, slots=True)
class Approach:
    """The plan of an approach to the wall."""

    speeds: tuple[float, ...]
    """At the wall, approximately [rad/s]"""
    stiffness: float
    damping: float
    coasting: float
    """Distance from the wall at which the torque ends [rad]"""


@dataclass(frozen=True, slots=True)
class Contact:
    """One contact; into the wall is positive."""

    entry: float
    """Speed [rad/s]"""
    exit: float
    """Speed on the way out after the last commanded torque has ended [rad/s]; 0: it crept out"""
    penetration: float
    """Greatest [rad]"""
    torque: float
    """Greatest commanded [N·m]"""
    seconds: float
    """In the wall"""
    time: FloatArray
    """From the entry [s]"""
    position: FloatArray
    """From the wall [rad]"""


def plan_approach(
    stiffness: float,
    damping: float,
    inertia: float,
    torque_limit: float,
    max_speed: float,
    lag: float,
) -> Approach | None:
    """Return speeds at which wall and torque limit suffice; None where there is no wall.

    Args:
        stiffness: Commanded [N·m/rad].
        damping: Commanded [N·m·s/rad].
        inertia: Per unit of commanded torque [kg·m²].
        torque_limit: [N·m].
        max_speed: Speed that trips [rad/s].
        lag: Total delay [s].
    """
    if stiffness <= 0.0:
        return None
    frequency = math.sqrt(stiffness / inertia)
    fastest = min(
        FASTEST,
        0.3 * max_speed,
        _SHARE * torque_limit / (stiffness / frequency + abs(damping)),
        DEEPEST * frequency,
    )
    coasting = fastest * (_COAST_S + lag)
    if coasting > 0.6 * START:
        fastest *= 0.6 * START / coasting
        coasting = 0.6 * START
    return Approach(tuple(share * fastest for share in _SPEEDS), stiffness, damping, coasting)


def approach_phases(
    approach: Approach, hold: Hold, fit: Fit, direction: float, lag: float, seed: int
) -> list[Phase]:
    """Return the program: back to the start, accelerate, into the wall; repeatedly.

    Args:
        approach: The plan.
        hold: The spring that brings the shaft back.
        fit: Relates torque and speed.
        direction: 1.0: the wall fills the positions above; -1.0: below.
        lag: Total delay [s].
        seed: Seed of small differences, so that the entries have random phases between two samples.
    """
    random = np.random.default_rng(seed)
    phases: list[Phase] = []
    for _ in range(_REPEATS):
        for speed in approach.speeds:
            wanted = speed * random.uniform(0.95, 1.05)
            coasting = wanted * (_COAST_S + lag)
            pushed = START - approach.coasting if coasting > approach.coasting else START - coasting
            squared = wanted**2 + 2.0 * fit.coulomb / fit.inertia * coasting
            torque = fit.inertia * squared / (2.0 * pushed) + fit.coulomb
            torque += fit.damping * wanted / 2.0
            back = -direction * START
            phases += [
                hold.phase(3.0, back, still_s=0.1),
                Phase(2.0, torque=direction * torque, center=back, reach=pushed),
                Phase(
                    _CONTACT_S,
                    approach.stiffness,
                    approach.damping,
                    side="above" if direction > 0 else "below",
                    reach=REACH,
                ),
            ]
    phases.append(hold.phase(2.0, still_s=0.1))
    return phases


def contacts(
    rows: NDArray[np.void],
    phases: Sequence[Phase],
    fit: Fit,
    direction: float,
    lag: float,
) -> list[Contact]:
    """Return the contacts in a log.

    Args:
        rows: Dtype ``telemetry.ROW``.
        phases: Phases of the program.
        fit: Describes the coasting.
        direction: 1.0: the wall fills the positions above; -1.0: below.
        lag: Total delay [s].
    """
    origin = float(rows["position"][0])
    rows = rows[rows["outcome"] == Outcome.OK]
    found = []
    number: IntArray = rows["phase"]
    for place, phase in enumerate(phases):
        if phase.side != "both":
            part = rows[number == place]
            contact = _contact(part, origin, fit, direction, lag)
            if contact is not None:
                found.append(contact)
    return found


def _contact(
    rows: NDArray[np.void], origin: float, fit: Fit, direction: float, lag: float
) -> Contact | None:
    x = direction * (rows["position"] - origin)
    inside = np.flatnonzero(x > 0.0)
    if inside.size < 2:
        return None
    time = (rows["sampled_ns"] - rows["sampled_ns"][0]) * 1e-9
    first = int(inside[0])
    outside_again = np.flatnonzero((x <= 0.0) & (np.arange(x.size) > first))
    # The accelerating torque acts for one more lag after the phase began.
    before = np.flatnonzero(
        (time > lag) & (time > time[first] - _WINDOW_S) & (np.arange(x.size) < first)
    )
    if before.size < _FEWEST:
        return None
    entry, crossed = _coasting(time[before], x[before], fit, 1.0)
    peak = int(np.argmax(x))
    leaving, seconds = 0.0, math.nan
    if outside_again.size:
        last = int(outside_again[0])
        seconds = float(time[last]) - crossed
        behind = np.flatnonzero((time > time[last] + lag) & (time < time[last] + lag + _WINDOW_S))
        still = np.flatnonzero(np.diff(x[behind]) > 0.0)
        behind = behind[: still[0] + 1] if still.size else behind
        if behind.size >= _FEWEST and x[behind[0]] - x[behind[-1]] > 0.0:
            leaving = max(-_speed_at(time[behind], x[behind], fit, -1.0), 0.0)
    return Contact(
        entry,
        leaving,
        float(x[peak]),
        float(np.max(np.abs(rows["wall_torque"]))),
        seconds,
        time - crossed,
        x,
    )


def _coasting(
    time: FloatArray, position: FloatArray, fit: Fit, direction: float
) -> tuple[float, float]:
    """Return the speed at the wall [rad/s] and the time of contact [s] of a coasting shaft."""
    at = float(time[-1])
    start, speed = _line(time - at, position, fit, direction)
    braking = -(direction * fit.coulomb + fit.damping * speed) / fit.inertia
    ahead = -start / speed if speed else 0.0
    ahead -= 0.5 * braking * ahead**2 / speed if speed else 0.0
    return speed + braking * ahead, at + ahead


def _speed_at(time: FloatArray, position: FloatArray, fit: Fit, direction: float) -> float:
    """Return the speed at the first of the samples [rad/s]."""
    return _line(time - time[0], position, fit, direction)[1]


def _line(
    time: FloatArray, position: FloatArray, fit: Fit, direction: float
) -> tuple[float, float]:
    """Return position and velocity at time 0 of a shaft that only friction decelerates."""
    once, twice, _ = held_response(np.full(time.shape, fit.damping / fit.inertia), time)
    columns = np.stack([np.ones_like(once), once], axis=1)
    braked = direction * fit.coulomb / fit.inertia * twice
    values = np.linalg.lstsq(columns, position + braked, rcond=None)[0]
    return float(values[0]), float(values[1])
