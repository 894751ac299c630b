"""Describes the mechanics of a servo in numbers: friction, gear load, weight, cogging, masses.

The whole equation of motion is ::

    m x'' = u + e - b x' - A sin(N x + phase) - F sign(x')
    e     = hand - G sin(x - angle)                                     external torque
    F     = c + l |u - e| + (s - c) exp(-|x'| / v_s)                    friction in motion

with u the torque of the motor's current and the viscous friction b one of two values by the
direction of motion. At rest the body is stuck while the torque on it is at most ``s + l |u - e|``.

Source: models M1 and M3 of Duclusaud et al., "Extended Friction Models for the Physics Simulation
of Servo Actuators" (2024), arXiv:2410.08650.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from haptic_wall.hw.truth import TrueServo, vibration

GRAIN_S = 2.5e-4
"""Longest substep where a torque changes during it [s]"""
PHASE = 0.02
"""Longest substep, in radians of the fastest oscillation that position-dependent torques make"""
TEETH = 0.3
"""Largest change of the phase of the cogging within a substep [rad]"""
FALL = 0.1
"""Largest change of speed within a substep, in Stribeck speeds, while the friction depends on it"""
FADED = 12.0
"""Power of the relative speed from which on nothing is left of the excess friction"""
SHORTEST_S = 1e-7
"""Substeps do not get shorter than this [s]; events do"""
LOOK_S = 5e-4
"""Longest substep between looks for events of two masses [s]"""
TURN = 0.5
"""Longest substep of two masses, in radians of their fastest vibration"""
FINEST_S = 5e-5
"""``TURN`` makes no substep shorter than this [s]"""


class Mechanics(NamedTuple):
    """Numbers of one servo; fields without a note are those of ``TrueServo``."""

    inertia: float
    forth: float
    """Viscous friction at positive velocities [N·m·s/rad]"""
    back: float
    """The same at negative ones"""
    coulomb: float
    static: float
    """s [N·m], at least ``coulomb``"""
    excess: float
    """s - c where it fades with the speed; 0 where it is gone at once [N·m]"""
    stribeck: float
    load: float
    """l"""
    gravity: float
    angle: float
    cogging: float
    periods: float
    phase: float
    half: float
    """Half of the backlash: before the encoder, or with a transmission between motor and output"""
    fading: bool
    """Whether the friction depends on the speed"""
    uneven: bool
    """Whether a torque changes within a step, so that it is divided"""
    smooth: bool
    """Whether the motion is linear throughout"""
    grain: float
    """Longest substep [s]"""
    faded: float
    """Speed from which on nothing is left of the excess friction [rad/s]"""
    behind: float
    """Inertia of the load behind the transmission [kg·m²]; 0: rigid"""
    joint: float
    """Stiffness of the transmission [N·m/rad]"""
    loss: float
    """Damping of the transmission [N·m·s/rad]"""
    rate: float
    """Bound of the rates of the linear motion of both masses [1/s]"""


def mechanics_of(true: TrueServo) -> Mechanics:
    """Return the mechanics of a simulated servo."""
    static = true.static_friction or true.coulomb
    back = true.damping if true.damping_back is None else true.damping_back
    excess = static - true.coulomb if true.stribeck_speed > 0.0 else 0.0
    fading = excess > 0.0
    cogs = true.cogging * true.cogging_periods
    stiffness = true.gravity + cogs
    uneven = fading or true.load_friction > 0.0 or stiffness > 0.0
    grain, rate = GRAIN_S if uneven else math.inf, 0.0
    smooth = not uneven and static == 0.0 and back == true.damping and true.backlash == 0.0
    if not true.flexible:
        if stiffness > 0.0:
            grain = finest(true.inertia, stiffness)
    else:
        fastest = vibration(true)[0]
        fade = 2.0 * true.transmission_damping / min(true.inertia, true.load_inertia)
        rate = fastest + fade + max(true.damping, back) / true.inertia
        if not smooth:
            grain = min(grain, LOOK_S, max(TURN / fastest, FINEST_S))
        if cogs > 0.0:
            grain = min(grain, finest(true.inertia, cogs))
        if true.gravity > 0.0:
            grain = min(grain, finest(true.load_inertia, true.gravity))
    return Mechanics(
        inertia=true.inertia,
        forth=true.damping,
        back=back,
        coulomb=true.coulomb,
        static=static,
        excess=excess,
        stribeck=true.stribeck_speed,
        load=true.load_friction,
        gravity=true.gravity,
        angle=true.gravity_angle,
        cogging=true.cogging,
        periods=true.cogging_periods,
        phase=true.cogging_phase,
        half=0.5 * true.backlash,
        fading=fading,
        uneven=uneven,
        smooth=smooth,
        grain=grain,
        faded=true.stribeck_speed * FADED,
        behind=true.load_inertia,
        joint=true.transmission_stiffness,
        loss=true.transmission_damping,
        rate=rate,
    )


def finest(inertia: float, stiffness: float) -> float:
    """Return the longest substep [s] with torques that change so much a radian [N·m/rad], > 0."""
    return max(min(GRAIN_S, PHASE * math.sqrt(inertia / stiffness)), SHORTEST_S)


def weight_at(p: Mechanics, position: float) -> float:
    """Return the torque of the weight at a position [N·m]."""
    return -p.gravity * math.sin(position - p.angle) if p.gravity > 0.0 else 0.0


def cogging_at(p: Mechanics, position: float) -> float:
    """Return the torque of the cogging at a position [N·m]."""
    return -p.cogging * math.sin(p.periods * position + p.phase) if p.cogging > 0.0 else 0.0


def most_friction(p: Mechanics, motor: float, external: float) -> float:
    """Return the largest friction at rest, for the torques of both sides [N·m]."""
    return p.static + abs(p.load * motor - p.load * external) if p.load > 0.0 else p.static


def left_of_excess(p: Mechanics, speed: float) -> float:
    """Return the fraction of the static friction's excess that is left at this speed."""
    if speed > p.faded:
        return 0.0
    return math.exp(-speed / p.stribeck)


def friction_at(p: Mechanics, speed: float, motor: float, external: float) -> float:
    """Return the friction in motion [N·m]."""
    friction = p.coulomb
    if p.load > 0.0:
        friction += abs(p.load * motor - p.load * external)
    if p.fading:
        friction += p.excess * left_of_excess(p, speed)
    return friction


def longest(p: Mechanics, grain: float, speed: float, gain: float) -> float:
    """Return the longest substep [s] at this speed and acceleration [rad/s²]."""
    if p.cogging > 0.0 and p.periods * speed * grain > TEETH:
        grain = max(TEETH / (p.periods * speed), SHORTEST_S)
    if not p.fading:
        return grain
    # The error of a substep goes with the square of the change and with what is left of the
    # excess: the further it has faded, the longer the substep. Twice: the speed changes in it.
    change = FALL * p.stribeck
    length, slower = grain, speed
    for _ in range(2):
        if slower > p.faded:
            return length
        left = math.sqrt(left_of_excess(p, slower))
        steepest = p.excess / p.inertia * left * left
        length = min(grain, change / (left * (abs(gain) + steepest)))
        slower = max(speed - abs(gain) * length, 0.0)
    return max(length, SHORTEST_S)
