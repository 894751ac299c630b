"""Describes walls on servos for simulation, and runs it: period by period, or for the limit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from haptic_wall.controller.experiments.maps import search
from haptic_wall.controller.experiments.maps.compiled import compiled
from haptic_wall.controller.experiments.maps.loop import (
    MEASURED,
    POSITION,
    RINGS,
    TORQUE,
    VELOCITY,
    Wall,
    begin,
    course,
)
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.plant.current_loop import Winding, drive_of
from haptic_wall.hw.plant.encoder import EncoderErrors
from haptic_wall.hw.plant.mechanics import mechanics_of
from haptic_wall.hw.plant.two_masses import ROOM, Buffer
from haptic_wall.hw.truth import TrueServo

_SNAP = 1e-9  # fraction of a period: a delay this near to a whole number is taken as whole
_NOISY = 16_384
"""Periods after which the encoder's noise repeats"""
_WORTH = 32
"""Least number of periods that are worth a compiled call"""


def wall_of(
    servo: TrueServo,
    *,
    period: float,
    delay: float,
    virtual_damping: float,
    one_sided: bool = False,
    velocity_samples: int = 1,
    limit: float = math.inf,
    offset: float = 0.0,
) -> Wall:
    """Return a wall on a servo.

    Args:
        servo: Its position, hand and delay are not used.
        period: T [s].
        delay: From a sample to the time at which its torque acts, the servo's own included [s].
        virtual_damping: B [N·m·s/rad].
        one_sided: The wall never pulls.
        velocity_samples: N of the velocity difference.
        limit: Torque limit of the wall, beside the servo's [N·m].
        offset: Of an encoder with an eccentricity [rad].

    Raises:
        ValueError: A value is out of range.
    """
    periods = delay / period
    whole = math.floor(periods + _SNAP)
    lag = delay - whole * period if periods - whole > _SNAP else 0.0
    body = mechanics_of(servo)
    return Wall(
        body=body,
        drive=drive_of(servo, Winding(servo.torque_limit, servo.no_load_speed)),
        on_motor=servo.encoder == "motor",
        counts=servo.counts_per_rev / (2.0 * math.pi),
        eccentricity=servo.encoder_eccentricity,
        encoder_phase=servo.encoder_phase,
        offset=offset,
        noise=servo.encoder_noise,
        limit=min(servo.torque_limit, limit),
        step=servo.torque_step,
        virtual_damping=virtual_damping,
        period=period,
        whole=whole,
        lag=lag,
        samples=velocity_samples,
        one_sided=one_sided,
        moved=servo.inertia + servo.load_inertia,
    )


@lru_cache(maxsize=8)
def noise_of(servo: TrueServo, period: float, periods: int) -> tuple[float, ...]:
    """Return the noise of its encoder in each period [counts]; empty: it has none."""
    if servo.encoder_noise == 0.0:
        return ()
    errors = EncoderErrors(servo)
    return tuple(errors.noise(round(k * period * 1e9)) for k in range(periods))


def buffers(wall: Wall, noise: Sequence[float] = ()) -> tuple[Buffer, Buffer]:
    """Return the buffers of a wall's simulation: lists, or arrays where it is compiled."""
    s = [*[0.0] * (RINGS + wall.samples + wall.whole + 3), *noise]
    z = [0.0] * ROOM
    return (s, z) if compiled() is None else (_array(s), _array(z))


def critical(
    wall: Wall, kick: float, guess: float, tolerance: float, servo: TrueServo | None = None
) -> float:
    """Return the stiffness above which the simulated motion after a kick grows [N·m/rad].

    Two-sided: the servo is let go at rest, ``kick`` from the wall, where it was held for long: it
    starts at a turning point with v = 0 and the velocity estimate sees no jump; the amplitude of
    the oscillation grows. One-sided: the servo comes freely with the speed that the spring alone
    would stop after ``kick``; that speed grows from entry to exit.

    Without friction, quantisation, backlash and limit the kick does not matter. With them the
    result is a property of the kick too.

    Args:
        wall: The wall.
        kick: > 0 [rad].
        guess: Where to look first [N·m/rad]; 0: there is no guess.
        tolerance: Wanted relative accuracy, > 0.
        servo: Its encoder makes the noise; None: there is none.

    Returns:
        The middle between two neighbouring stiffnesses, of which one grows. 0 where the motion
        grows at the softest wall tried (1e-4 m/T², and below half the guess), inf where it does not
        at the stiffest (20 m/T²).
    """
    functions = compiled()
    run = search.onset if functions is None else functions.onset
    noise = () if servo is None else noise_of(servo, wall.period, _NOISY)
    return float(run(wall, *buffers(wall, noise), kick, guess, tolerance))


class Loop:
    """Simulates one wall.

    The servo starts after a long rest at its position, without torque, or moves freely with a
    velocity; the first velocity estimate is 0, as in the program.

    Args:
        wall: The wall.
        stiffness: K [N·m/rad].
        position: At the start [rad].
        velocity: At the start [rad/s].
        noise: Of the encoder in each period, from ``noise_of``.

    Attributes:
        k: Periods simulated.
    """

    def __init__(
        self,
        wall: Wall,
        stiffness: float,
        position: float,
        velocity: float = 0.0,
        *,
        noise: Sequence[float] = (),
    ) -> None:
        self._wall = wall
        self._s, self._z = buffers(wall, noise)
        self.k = 0
        begin(wall, self._s, self._z, stiffness, position, velocity)

    @property
    def position(self) -> float:
        """Return the true position of the side that the encoder measures [rad]."""
        return float(self._s[POSITION])

    @property
    def velocity(self) -> float:
        """Return its velocity [rad/s]."""
        return float(self._s[VELOCITY])

    @property
    def measured(self) -> float:
        """Return the last measured position [rad]."""
        return float(self._s[MEASURED])

    @property
    def torque(self) -> float:
        """Return the last commanded torque, after limit and rounding [N·m]."""
        return float(self._s[TORQUE])

    def run(self, periods: int, push: float | FloatArray = 0.0) -> FloatArray:
        """Simulate some periods.

        Args:
            periods: Number of periods.
            push: Torque of an operator on the motor's side [N·m], held over each period; an array
                has one for each.

        Returns:
            Position and velocity at the end of each period, measured position and commanded torque
            of each; shape (periods, 4).
        """
        pushes = np.atleast_1d(np.asarray(push, dtype=np.float64))
        functions = compiled()
        if functions is not None and periods >= _WORTH:
            found = np.empty(4 * periods)
            functions.course(self._wall, self._s, self._z, self.k, periods, pushes, found)
        else:
            rows = [0.0] * (4 * periods)
            course(self._wall, self._s, self._z, self.k, periods, pushes.tolist(), rows)
            found = np.array(rows)
        self.k += periods
        return found.reshape(periods, 4)


def _array(values: Sequence[float]) -> Buffer:
    found: Buffer = np.array(values, dtype=np.float64)  # type: ignore[assignment]
    return found
