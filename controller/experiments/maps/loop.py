"""Simulates one wall on one servo: encoder, velocity, law, delay, torque limit, servo.

A wall is simulated as the program would run it alone on the simulated clock with the simulated
servo (without guard, safety and operator): the servo moves by the same functions of
``haptic_wall.hw.plant``. All functions are plain, so that Numba compiles them as they are
(``compiled``). Buffers are lists, and arrays where it is compiled.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from haptic_wall.hw.plant.current_loop import (
    STEP_S,
    Drive,
    end_of,
    goal_for,
    mean_of,
    target_of,
)
from haptic_wall.hw.plant.mechanics import Mechanics
from haptic_wall.hw.plant.step import NOBODY, Kept, kept_for, move
from haptic_wall.hw.plant.two_masses import Buffer, swing

# Places in the buffer of a simulation.
POSITION: Final = 0
"""Of the side that the encoder measures [rad]"""
VELOCITY: Final = 1
FOLLOWED: Final = 2
"""Position of the encoder's side of its backlash [rad]"""
END: Final = 3
"""Position of the output, with a transmission [rad]"""
U: Final = 4
"""Of the current loop [N·m]"""
ACCELERATION: Final = 5
"""Over the last step of the current loop [rad/s²]"""
TORQUE: Final = 6
"""Last commanded torque, after limit and rounding [N·m]"""
MEASURED: Final = 7
"""Last measured position [rad]"""
STIFFNESS: Final = 8
"""K [N·m/rad]"""
SUMS: Final = 9
"""Of two lines, six for each"""
RINGS: Final = 21
"""Measured positions of the last ``samples + 1`` periods [rad], torques of the last ``whole + 2``
[N·m], and the encoder's noise in each period [counts], which repeats"""


MOST_COUNTS: Final = 1e15
"""Largest reading of an encoder [counts]"""


class Wall(NamedTuple):
    """A wall at position 0 on a servo; a one-sided one fills the positions above.

    The stiffness is in the simulation's buffer, since searches vary it.
    """

    body: Mechanics
    drive: Drive
    on_motor: bool
    """Whether the encoder measures the motor's side of a transmission"""
    counts: float
    """Counts per radian of the encoder; 0: the position is not quantised"""
    eccentricity: float
    """Amplitude of the encoder's error once a turn [rad]"""
    encoder_phase: float
    """[rad]"""
    offset: float
    """Added to every reading with an eccentricity [rad]: where the encoder's zero is"""
    noise: float
    """Standard deviation [counts]"""
    limit: float
    """Torque limit [N·m], > 0, may be infinite"""
    step: float
    """Torques are rounded to multiples of it [N·m]; 0: none"""
    virtual_damping: float
    """B [N·m·s/rad]"""
    period: float
    """T [s]"""
    whole: int
    """Whole periods of the delay"""
    lag: float
    """Remainder of the delay beyond them [s], from 0 to less than T"""
    samples: int
    """N of the velocity difference"""
    one_sided: bool
    """Whether the wall never pulls"""
    moved: float
    """The whole inertia that moves, loads included [kg·m²]"""


def begin(
    wall: Wall, s: Buffer, z: Buffer, stiffness: float, position: float, velocity: float
) -> None:
    """Start a servo after a long rest at a position, without torque, or with a velocity.

    Args:
        wall: The wall.
        s: The simulation's buffer; its noise stays.
        z: The state of ``two_masses``.
        stiffness: K [N·m/rad].
        position: [rad].
        velocity: [rad/s].
    """
    for i in range(RINGS + wall.samples + wall.whole + 3):
        s[i] = 0.0
    s[POSITION] = s[FOLLOWED] = s[END] = position
    s[VELOCITY] = velocity
    s[STIFFNESS] = stiffness
    s[U] = wall.drive.back_emf * velocity
    z[0] = z[2] = velocity
    z[1] = z[3] = 0.0


def keep(wall: Wall, duration: float) -> Kept:
    """Return the response that the steps of this part of a period need mostly."""
    if wall.drive.acts:
        return kept_for(wall.body, NOBODY, wall.drive.back_emf, duration / steps_of(duration))
    return kept_for(wall.body, NOBODY, 0.0, duration)


def steps_of(duration: float) -> int:
    """Return into how many steps of the current loop a part of a period [s] is divided."""
    return max(1, math.ceil(duration / STEP_S - 1e-9))


def command(wall: Wall, s: Buffer, k: int) -> None:
    """Measure in period ``k``, and command the wall's torque, limited and rounded."""
    samples, whole = wall.samples, wall.whole
    torques = RINGS + samples + 1
    seen = s[FOLLOWED]
    if wall.eccentricity > 0.0:
        seen += wall.eccentricity * math.sin(seen + wall.encoder_phase) + wall.offset
    counts = wall.counts
    if counts > 0.0:
        turned = seen * counts
        if wall.noise > 0.0:
            noise = torques + whole + 2
            turned += s[noise + k % (len(s) - noise)]
        # What has grown out of all bounds is not counted.
        seen = round(turned) / counts if abs(turned) < MOST_COUNTS else seen
    torque = -s[STIFFNESS] * seen
    back = k if k < samples else samples
    if back > 0:
        earlier = s[RINGS + (k - back) % (samples + 1)]
        torque -= wall.virtual_damping * ((seen - earlier) / (back * wall.period))
    s[RINGS + k % (samples + 1)] = seen
    if wall.one_sided and (seen <= 0.0 or torque > 0.0):
        torque = 0.0
    limit, step = wall.limit, wall.step
    if torque > limit:
        torque = limit
    elif torque < -limit:
        torque = -limit
    if step > 0.0:
        steps = round(torque / step) if abs(torque / step) < MOST_COUNTS else 0
        torque = steps * step
        if abs(torque) > limit:
            torque = (steps - math.copysign(1.0, steps)) * step
    s[TORQUE], s[MEASURED] = torque, seen
    s[torques + k % (whole + 2)] = torque


def act(
    wall: Wall, s: Buffer, z: Buffer, kept: Kept, k: int, ago: int, push: float, duration: float
) -> None:
    """Move the servo for a part of period ``k``.

    Args:
        wall: The wall.
        s: The simulation's buffer.
        z: The state of ``two_masses``.
        kept: From ``keep``.
        k: The period.
        ago: The torque was commanded so many periods before.
        push: Torque of an operator on the motor's side [N·m].
        duration: [s].
    """
    drive = wall.drive
    torque = s[RINGS + wall.samples + 1 + (k - ago) % (wall.whole + 2)]
    if not drive.acts:
        if wall.body.behind == 0.0:  # as ``pass_time``, for speed
            s[POSITION], s[VELOCITY], s[FOLLOWED] = move(
                *(wall.body, kept, NOBODY, s[POSITION], s[VELOCITY], s[FOLLOWED]),
                *(torque + push, 0.0, duration),
            )
            return
        pass_time(wall, s, z, kept, torque + push, 0.0, duration)
        return
    goal, steps = goal_for(drive, torque), steps_of(duration)
    length = duration / steps
    for _ in range(steps):
        velocity = motor_velocity(wall, s, z)
        target, u, braking = target_of(drive, goal, s[U], velocity, s[ACCELERATION])
        mean = mean_of(drive, target, u, length)
        pass_time(wall, s, z, kept, mean + push, braking, length)
        s[U] = end_of(drive, target, u, length)
        s[ACCELERATION] = (motor_velocity(wall, s, z) - velocity) / length


def pass_time(
    wall: Wall, s: Buffer, z: Buffer, kept: Kept, torque: float, braking: float, duration: float
) -> None:
    """Move the servo under a held torque [N·m]."""
    body = wall.body
    if body.behind == 0.0:
        s[POSITION], s[VELOCITY], s[FOLLOWED] = move(
            *(body, kept, NOBODY, s[POSITION], s[VELOCITY], s[FOLLOWED]),
            *(torque, braking, duration),
        )
        return
    s[END] = swing(body, NOBODY, z, s[END], torque, braking, duration)
    s[POSITION] = motor_position(wall, s, z) - (0.0 if wall.on_motor else z[1])
    s[VELOCITY] = z[0] if wall.on_motor else z[2]
    s[FOLLOWED] = s[POSITION]


def motor_velocity(wall: Wall, s: Buffer, z: Buffer) -> float:
    """Return the speed of the motor's side [rad/s]."""
    return s[VELOCITY] if wall.body.behind == 0.0 else z[0]


def motor_position(wall: Wall, s: Buffer, z: Buffer) -> float:
    """Return the position of the motor's side [rad]."""
    if wall.body.behind == 0.0:
        return s[POSITION]
    return s[END] + z[1]


def course(
    wall: Wall, s: Buffer, z: Buffer, first: int, periods: int, pushes: Buffer, found: Buffer
) -> None:
    """Simulate some periods.

    Args:
        wall: The wall.
        s: The simulation's buffer, from ``begin`` or an earlier call.
        z: The state of ``two_masses``.
        first: Number of the first period.
        periods: Number of periods.
        pushes: Torque of an operator in each [N·m]; the last one stays.
        found: Gets position and velocity at the end of each period, measured position and
            commanded torque of each; empty: nobody wants them.
    """
    rest = wall.period - wall.lag
    late, held = keep(wall, wall.lag), keep(wall, rest)
    for i in range(periods):
        k = first + i
        push = pushes[min(i, len(pushes) - 1)]
        command(wall, s, k)
        if wall.lag > 0.0:
            act(wall, s, z, late, k, wall.whole + 1, push, wall.lag)
        act(wall, s, z, held, k, wall.whole, push, rest)
        if len(found) > 0:
            found[4 * i], found[4 * i + 1] = s[POSITION], s[VELOCITY]
            found[4 * i + 2], found[4 * i + 3] = s[MEASURED], s[TORQUE]
