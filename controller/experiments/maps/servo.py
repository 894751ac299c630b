"""The servo and the loop that a map simulates, and the theory's limits of its walls."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.linear_loop import LinearLoop
from haptic_wall.controller.experiments.maps.loop import Wall
from haptic_wall.controller.experiments.maps.walls import wall_of
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory import linear_limit, one_sided_limit
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.controller.theory.one_sided import one_sided_with_load
from haptic_wall.hw.plant.mechanics import mechanics_of
from haptic_wall.hw.truth import TrueServo


@dataclass(frozen=True, slots=True)
class MapSettings:
    """The servo and the loop of a map; can be sent to other processes."""

    servo: TrueServo
    """The servo; its delay adds to the map's, its position and operator are not used"""
    period_ns: int
    """Sampling period [ns]"""
    one_sided: bool
    """Whether the wall never pulls"""
    velocity_samples: int = 1
    """N of the velocity difference"""
    torque_clip: float = math.inf
    """Largest torque of the wall [N·m]"""

    @classmethod
    def of(cls, config: Config) -> MapSettings:
        """Return the setting of a configuration, whose simulated or emulated servo is the truth.

        Raises:
            UserError: The servo is real, or has an effect that a map leaves out.
        """
        if config.servo.kind == "hardware":
            raise UserError(
                f"found a real servo at {config.servo.port}",
                field="CONFIG",
                wanted="a simulated or an emulated one, whose truth is known",
                advice="name such a configuration, or set servo.backend=simulated and the "
                "servo's identified values",
            )
        servo, wall = config.true_servo(), config.wall
        tick_ns = round(servo.current_period * 1e9)
        if tick_ns and config.period_ns % tick_ns:
            raise UserError(
                f"found {servo.current_period:g} s",
                field="servo.current_period",
                wanted=f"the loop's period, {config.period_s:g} s, divided by a whole number",
                advice="change it, or use haptic-wall sweep",
            )
        if servo.back_emf and config.servo.kind != "simulated":
            raise UserError(
                "found true for an emulated servo, whose motor a map does not know",
                field="servo.back_emf",
                advice="set servo.backend=simulated, servo.torque_limit and servo.no_load_speed",
            )
        clip = math.inf if wall.torque_clip is None else wall.torque_clip
        return cls(servo, config.period_ns, wall.side != "both", wall.velocity_samples, clip)

    @property
    def period(self) -> float:
        """Return the sampling period [s]."""
        return self.period_ns * 1e-9

    @property
    def loop(self) -> LinearLoop:
        """Return the servo without friction and encoder in its loop."""
        servo, load = self.servo, None
        if servo.flexible:
            load = servo.load_inertia, servo.transmission_stiffness, servo.transmission_damping
        inertia = servo.inertia + servo.load_inertia * servo.flexible
        rest = (self.velocity_samples, None, load, servo.encoder)
        return LinearLoop(inertia, servo.damping, self.period, *rest)

    @property
    def kick_matters(self) -> bool:
        """Whether the result depends on the kick, apart from the torque limit."""
        servo = self.servo
        return (
            servo.coulomb > 0.0
            or servo.counts_per_rev > 0
            or servo.backlash > 0.0
            or servo.encoder_eccentricity > 0.0
            or not mechanics_of(servo).smooth
        )

    def delay(self, steps: IntArray) -> FloatArray:
        """Return the total delay [s] with this many inserted periods."""
        total_ns = np.asarray(steps) * self.period_ns + round(self.servo.delay * 1e9)
        return total_ns.astype(np.float64) * 1e-9

    def wall(self, virtual_damping: float, steps: int) -> Wall:
        """Return the wall with this virtual damping and this many inserted periods."""
        return wall_of(
            self.servo,
            period=self.period,
            delay=(steps * self.period_ns + round(self.servo.delay * 1e9)) * 1e-9,
            virtual_damping=float(virtual_damping),
            one_sided=self.one_sided,
            velocity_samples=self.velocity_samples,
            limit=self.torque_clip,
        )

    def limits(
        self, damping: FloatArray, delay: FloatArray, tolerance: float = 1e-4
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the linear, the exact and the one-sided limit without friction [N·m/rad].

        Args:
            damping: B, shape (n,) [N·m·s/rad].
            delay: t_d, shape (m,) [s].
            tolerance: Wanted relative accuracy of the one-sided limit; 0.01 is quick.

        Returns:
            Each of delays × dampings.
        """
        servo, period, n = self.servo, self.period, self.velocity_samples
        late = delay[:, None]
        linear = linear_limit(servo.damping, damping, period, late)
        loop = self.loop
        exact = np.asarray(loop.critical(damping, late).stiffness)
        walls = (damping, period, late, n, tolerance)
        if loop.load is None:
            return linear, exact, one_sided_limit(servo.inertia, servo.damping, *walls)
        return linear, exact, one_sided_with_load(loop.chain(), exact, *walls)
