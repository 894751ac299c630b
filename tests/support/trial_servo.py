"""A servo for trials behind the servo interface: in-process, and as bad as its truth.

The program's own plant moves it. Beside that it has an operator with a mass on the output, and a
motor that makes more or less torque than commanded. It does *not* model a bus (reading and writing
take no time, nothing is lost), a current sensor, or temperature.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from haptic_wall.hw.clock import Clock
from haptic_wall.hw.plant.current_loop import Winding
from haptic_wall.hw.plant.mechanics import mechanics_of
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.plant.step import Hand
from haptic_wall.hw.servo import Check, Facts, Outcome, Reading
from haptic_wall.hw.truth import TrueServo
from tests.support.operators import NOBODY, Operator
from tests.support.truth import Truth

_NEVER_NS = 1 << 62
_SOFT = 1e-3
"""Spring of an operator that only pushes the plant, toward a reference far away [N·m/rad]"""


class TrialServo:
    """A bus of one simulated servo; see the module.

    Attributes:
        outputs: True position of the output at each request [rad]; grows by one per request.
    """

    def __init__(
        self,
        truth: Truth,
        clock: Clock,
        operator: Operator = NOBODY,
        *,
        position: float = 0.0,
        velocity: float = 0.0,
        struck: float = 0.0,
    ) -> None:
        """Create a servo without torque.

        Args:
            truth: Its true parameters.
            clock: Its time.
            operator: Moves the output, from now on.
            position: Position of both masses [rad]; the encoder is in the middle of its backlash.
            velocity: Velocity of both masses [rad/s].
            struck: Velocity that the load behind a transmission has in addition [rad/s].
        """
        self.truth = truth
        self.facts = [
            Facts(
                name="trial servo",
                counts_per_rev=truth.counts_per_rev,
                torque_limit=truth.torque_limit,
                torque_step=truth.torque_step,
                stall_torque=truth.stall_torque / truth.torque_gain,
                no_load_speed=truth.no_load_speed,
            )
        ]
        self.traffic = None
        self.trouble = ""
        self.given_up: Callable[[], bool] = lambda: False
        self.outputs: list[float] = []
        self._now_ns = clock.now_ns
        self._reading: Reading | None = None
        start_ns = clock.now_ns()
        self._released_ns = start_ns + len(operator.rows) * operator.row_ns
        """When the operator lets go; then its mass is gone"""
        self._heavy = bool(operator.mass and operator.rows)
        self._plant = Mechanism(
            true_servo(truth, position, operator.mass if self._heavy else 0.0),
            start_ns,
            velocity=velocity,
            winding=Winding(truth.stall_torque, truth.no_load_speed),
            operator=_Rows(operator) if operator.rows else None,
        )
        if struck:
            self._plant._z[2] += struck

    def health(self) -> list[tuple[float, float]]:
        """Return nothing: it reports none."""
        return []

    def start(self) -> list[list[Check]]:
        """Return no checks; its time runs since its creation."""
        return [[]]

    def request(self) -> None:
        """Sample the position now."""
        now_ns = self._now_ns()
        plant = self._plant
        if self._heavy and now_ns >= self._released_ns:
            self._heavy = False
            plant.advance(self._released_ns)
            plant.mechanics = mechanics_of(true_servo(self.truth, 0.0))
            plant._kept.clear()
        plant.advance(now_ns)
        self.outputs.append(plant.position)
        self._reading = Reading(Outcome.OK, *plant.measured(), now_ns, math.nan, False)

    def collect(self, deadline_ns: int) -> list[Reading]:  # noqa: ARG002 - nothing to wait for
        """Return the sample of the last ``request``, at once."""
        assert self._reading is not None, "call request first"
        return [self._reading]

    def write(self, torques: Sequence[float]) -> list[float]:
        """Command a torque that acts ``truth.delay`` later; return it limited and rounded [N·m]."""
        gain = self.truth.torque_gain
        (torque,) = torques
        return [self._plant.command(gain * torque, self._now_ns()) / gain]

    def stop(self) -> bool:
        """Switch torque off. Always succeeds."""
        self._plant.command(0.0, self._now_ns())
        return True

    def close(self) -> None:
        """Do nothing: it holds no resource."""


def true_servo(truth: Truth, position: float, mass: float = 0.0) -> TrueServo:
    """Return the plant's description of a servo.

    Args:
        truth: The servo; the lag of the current loop of ``truth.real`` is a part of its delay.
        position: [rad]
        mass: Of an operator on the output [kg·m²].
    """
    real: dict[str, Any] = truth.real or {"current_bandwidth": truth.current_bandwidth}
    lag = 1.0 / (math.tau * real["current_bandwidth"]) if truth.real else 0.0
    motor = truth.inertia - truth.load_inertia
    return TrueServo(
        inertia=motor if truth.flexible else motor + mass,
        damping=truth.damping + (truth.braking if truth.back_emf == "voltage" else 0.0),
        coulomb=truth.coulomb,
        load_inertia=truth.load_inertia + mass if truth.flexible else 0.0,
        transmission_stiffness=truth.transmission_stiffness,
        transmission_damping=truth.transmission_damping,
        encoder=truth.encoder,
        counts_per_rev=truth.counts_per_rev,
        delay=max(truth.delay - lag, 0.0),
        torque_limit=truth.torque_gain * truth.torque_limit,
        torque_step=truth.torque_gain * truth.torque_step,
        backlash=truth.backlash,
        back_emf=truth.back_emf == "current",
        no_load_speed=truth.no_load_speed,
        position=position,
        **real,
    )


class _Rows:
    """The operator of a trial, as the plant asks for it."""

    def __init__(self, operator: Operator) -> None:
        self._rows, self._row_ns = operator.rows, operator.row_ns

    def pull(self, elapsed_ns: int) -> tuple[Hand, int]:
        """Return the hand at ``elapsed_ns``, and when it changes [ns since the start]."""
        at = elapsed_ns // self._row_ns
        if at >= len(self._rows):
            return Hand(), _NEVER_NS
        spring, damper, wanted, speed, push = self._rows[at]
        if push:
            spring = spring or _SOFT
            wanted += push / spring
        wanted += speed * (elapsed_ns - at * self._row_ns) * 1e-9
        return Hand(spring, damper, wanted, speed), (at + 1) * self._row_ns
