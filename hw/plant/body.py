"""Simulates a one-axis servo exactly under held torque, friction and operator; no time stepping.

The motion over a step solves ::

    m x'' = u - b x' - c sign(x') + k_h (r0 + r1 t - x) + b_h (r1 - x')

with the torque u held and the operator a spring and damper toward a reference that moves linearly.
While the velocity keeps its sign the equation is linear and has a closed form
(``haptic_wall.hw.plant.response``). The step is divided at the instants where the velocity reaches
zero and where a stuck body breaks away; the module solves for each of them.

At rest the body is stuck while the applied torque is at most c (static friction equals
kinetic friction).

Near the stability boundary a loop grows by 1e-7 per sample. The damping of a fixed-step integrator
would be as large.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from haptic_wall.hw.errors import SpecError
from haptic_wall.hw.plant.response import Slide, cached_response, response, time_to_rest

_ONE_TURN = 9.0
"""Square of a phase below pi: two zeros of an oscillator's acceleration are at least pi apart"""


@dataclass(frozen=True, slots=True)
class PlantParameters:
    """Parameters of the body.

    Raises:
        ValueError: A value is out of range.
    """

    inertia: float
    """[kg·m²], > 0"""
    damping: float = 0.0
    """Viscous friction [N·m·s/rad], >= 0"""
    coulomb: float = 0.0
    """Coulomb friction [N·m], >= 0"""

    def __post_init__(self) -> None:
        if not 0.0 < self.inertia < math.inf:
            raise SpecError(
                f"inertia is {self.inertia} kg·m²", advice="give a finite value above 0"
            )
        if not 0.0 <= self.damping < math.inf:
            raise SpecError(
                f"damping is {self.damping} N·m·s/rad", advice="give a finite value from 0 up"
            )
        if not 0.0 <= self.coulomb < math.inf:
            raise SpecError(
                f"coulomb is {self.coulomb} N·m", advice="give a finite value from 0 up"
            )


class State(NamedTuple):
    """Position and velocity of the body."""

    position: float
    """[rad]"""
    velocity: float
    """[rad/s]"""


class Pull(NamedTuple):
    """The operator's spring and damper toward a moving reference, during one step."""

    stiffness: float
    """[N·m/rad], >= 0"""
    damping: float
    """[N·m·s/rad], >= 0"""
    reference: float
    """Reference position at the start of the step [rad]"""
    slope: float
    """Speed of the reference during the step [rad/s]"""


def step(
    state: State,
    parameters: PlantParameters,
    torque: float,
    duration: float,
    pull: Pull | None = None,
    *,
    turns: list[float] | None = None,
) -> State:
    """Return the state after ``duration`` [s] under a held torque.

    Args:
        state: Position [rad] and velocity [rad/s] at the start.
        parameters: The body.
        torque: Held over the whole step [N·m].
        duration: Length of the step [s], >= 0, of any size.
        pull: The operator; None: no operator.
        turns: If given, the positions [rad] at which the velocity reached zero within the step are
            appended in order: between them the motion is monotone.
    """
    position, velocity = state
    inertia, damping, coulomb = parameters.inertia, parameters.damping, parameters.coulomb
    if pull is None:
        if turns is not None:
            return _step_with_events(state, parameters, torque, duration, pull=None, turns=turns)
        if coulomb == 0.0:
            h1, h, s, _ = cached_response(damping / inertia, 0.0, duration)
            push = torque / inertia
            return State(position + velocity * h + push * s, velocity * h1 + push * h)
        if velocity == 0.0 and abs(torque) <= coulomb:
            return state
        direction = velocity or torque
        h1, h, s, _ = cached_response(damping / inertia, 0.0, duration)
        push = (torque - math.copysign(coulomb, direction)) / inertia
        end = velocity * h1 + push * h
        # Without a spring the velocity is monotone: if it keeps its sign it was never zero.
        if end * direction > 0.0:
            return State(position + velocity * h + push * s, end)
    elif velocity != 0.0 or (coulomb == 0.0 and turns is None):
        # Inlined for speed: nearly every period of a servo with an operator takes this path.
        stiffness, grip, reference, slope = pull
        spring = stiffness / inertia
        decay = (damping + grip) / inertia
        ramp = spring * slope
        push = (torque + grip * slope + stiffness * (reference - position)) / inertia
        h1, h, s, r = cached_response(decay, spring, duration)
        if coulomb == 0.0 and turns is None:
            distance = velocity * h + push * s + ramp * r
            return State(position + distance, velocity * h1 + push * h + ramp * s)
        direction = math.copysign(1.0, velocity)
        push -= direction * (coulomb / inertia)
        distance, end = velocity * h + push * s + ramp * r, velocity * h1 + push * h + ramp * s
        if end * direction > 0.0 and spring * duration * duration < _ONE_TURN:
            # The acceleration is zero at most once in so short a step. The speed can have reached
            # zero and come back only if it fell at the start and grows at the end.
            fell = (push - decay * velocity) * direction < 0.0
            left = push + ramp * duration - spring * distance - decay * end
            if not fell or left * direction <= 0.0:
                return State(position + distance, end)
    return _step_with_events(state, parameters, torque, duration, pull=pull, turns=turns)


def _slide(
    position: float, velocity: float, parameters: PlantParameters, torque: float, pull: Pull | None
) -> Slide:
    """Return the motion per unit inertia, without Coulomb friction."""
    inertia = parameters.inertia
    if pull is None:
        return Slide(velocity, torque / inertia, 0.0, parameters.damping / inertia, 0.0)
    stiffness, damping, reference, slope = pull
    spring = stiffness / inertia
    return Slide(
        velocity,
        (torque + damping * slope + stiffness * (reference - position)) / inertia,
        spring * slope,
        (parameters.damping + damping) / inertia,
        spring,
    )


def _step_with_events(
    state: State,
    parameters: PlantParameters,
    torque: float,
    duration: float,
    *,
    pull: Pull | None,
    turns: list[float] | None = None,
) -> State:
    """Take the general step: slide to the next event, decide, continue.

    The number of events is bounded. A body that breaks away from rest slides for at least half a
    period of the operator's spring, except for one short slide against the reference's motion,
    after which it sticks or slides along with it. The loop's bound only matters where rounding
    makes events coincide; the body is at rest then.
    """
    position, velocity = state
    _, start_push, ramp, decay, spring = _slide(position, velocity, parameters, torque, pull)
    start_position = position
    friction = parameters.coulomb / parameters.inertia
    elapsed = 0.0
    for _ in range(8 + int(4.0 * duration * math.sqrt(spring))):
        # The acceleration without friction of a body at rest here.
        push = start_push + ramp * elapsed - spring * (position - start_position)
        if velocity != 0.0:
            direction = math.copysign(1.0, velocity)
            push -= direction * friction
        elif abs(push) > friction:
            direction = math.copysign(1.0, push)
            push -= direction * friction
        elif ramp == 0.0:
            break
        else:
            direction = math.copysign(1.0, ramp)
            elapsed += (direction * friction - push) / ramp
            push = 0.0
            if elapsed >= duration:
                break
        left = duration - elapsed
        slide = Slide(velocity, push, ramp, decay, spring)
        rest = time_to_rest(slide, left)
        if rest is None:
            distance, velocity = slide.moved(cached_response(decay, spring, left))
            # Rounding may put the end on the other side of zero: it is zero.
            return State(position + distance, velocity if velocity * direction > 0.0 else 0.0)
        position += slide.moved(response(decay, spring, rest))[0]
        velocity = 0.0
        elapsed += rest
        if turns is not None:
            turns.append(position)
    return State(position, 0.0)
