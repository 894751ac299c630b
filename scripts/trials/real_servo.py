"""A servo for trials with every effect of a real one: the program's own plant.

It takes the operators of trials, without their mass. It does *not* model a bus, as ``TrialServo``.
"""

from __future__ import annotations

import math
from dataclasses import asdict

from haptic_wall.hw.clock import Clock
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.plant.operator_model import ReferenceStretch
from haptic_wall.hw.servo import Bus, Check, Facts, Outcome, Reading
from haptic_wall.hw.settings import TrueServo
from scripts.trials.operators import NOBODY, Operator
from scripts.trials.truth import RealEffects, Truth

_SOFT = 1e-3
"""Spring of an operator that only pushes, toward a reference far away [N·m/rad]"""
_NEVER_NS = 1 << 62


class RealTrialServo:
    """A simulated servo; see the module.

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
    ) -> None:
        """Create a servo without torque.

        Args:
            truth: Its true parameters, with ``real``.
            clock: Its time.
            operator: Moves the output, from now on.
            position: [rad]
            velocity: [rad/s]

        Raises:
            ValueError: The operator has a mass, or the truth no effects.
        """
        if truth.real is None or operator.mass:
            raise ValueError(
                f"truth.real is {truth.real}, the operator's mass {operator.mass}; give effects, "
                "and an operator without a mass"
            )
        self.truth = truth
        self.facts = Facts(
            name="trial servo with every effect",
            counts_per_rev=truth.counts_per_rev,
            torque_limit=truth.torque_limit,
            torque_step=truth.torque_step,
            stall_torque=truth.stall_torque / truth.torque_gain,
            no_load_speed=truth.no_load_speed,
        )
        self.bus: Bus | None = None
        self.outputs: list[float] = []
        self._now_ns = clock.now_ns
        self._mechanism = Mechanism(
            true_servo(truth, truth.real, position),
            clock.now_ns(),
            velocity=velocity,
            operator=_Rows(operator) if operator.rows else None,
        )
        self._reading: Reading | None = None

    def start(self) -> list[Check]:
        """Return no checks; its time runs since its creation."""
        return []

    def request(self) -> None:
        """Sample the position now."""
        now_ns = self._now_ns()
        mechanism = self._mechanism
        mechanism.advance(now_ns)
        self.outputs.append(mechanism.position)
        position, counts = mechanism.measured()
        self._reading = Reading(Outcome.OK, position, counts, now_ns, math.nan, False)

    def collect(self, deadline_ns: int) -> Reading:  # noqa: ARG002 - nothing to wait for
        """The sample of the last ``request``, at once.

        Raises:
            RuntimeError: There was no request.
        """
        reading = self._reading
        if reading is None:
            raise RuntimeError("a reading was collected without a request; call request first")
        self._reading = None
        return reading

    def write(self, torque: float) -> float:
        """Command a torque [N·m]; it acts ``truth.delay`` later.

        Returns:
            The torque after limit and rounding [N·m].

        Raises:
            ValueError: The torque is not a finite number.
        """
        gain = self.truth.torque_gain
        return self._mechanism.command(gain * torque, self._now_ns()) / gain

    def stop(self) -> bool:
        """Switch torque off. Always succeeds."""
        self._mechanism.command(0.0, self._now_ns())
        return True

    def close(self) -> None:
        """Do nothing: it holds no resource."""


def true_servo(truth: Truth, real: RealEffects, position: float) -> TrueServo:
    """Return the plant's description of a servo at a position [rad].

    The lag of the current loop is a part of ``truth.delay``.
    """
    lag = 1.0 / (math.tau * real.current_bandwidth)
    return TrueServo(
        inertia=truth.inertia,
        damping=truth.damping,
        coulomb=truth.coulomb,
        counts_per_rev=truth.counts_per_rev,
        delay=max(truth.delay - lag, 0.0),
        torque_limit=truth.torque_gain * truth.torque_limit,
        torque_step=truth.torque_gain * truth.torque_step,
        backlash=truth.backlash,
        back_emf=truth.back_emf == "current",
        no_load_speed=truth.no_load_speed,
        position=position,
        **asdict(real),
    )


class _Rows:
    """The operator of a trial, as the plant asks for it."""

    def __init__(self, operator: Operator) -> None:
        self._rows, self._row_ns = operator.rows, operator.row_ns

    def pull(self, elapsed_ns: int) -> ReferenceStretch:
        """Return the stretch of the reference at ``elapsed_ns`` [ns since the start]."""
        at = elapsed_ns // self._row_ns
        if at >= len(self._rows):
            return ReferenceStretch(0.0, 0.0, _NEVER_NS, 0.0, 0.0)
        spring, damper, wanted, speed, push = self._rows[at]
        if push:
            spring = spring or _SOFT
            wanted += push / spring
        wanted += speed * (elapsed_ns - at * self._row_ns) * 1e-9
        return ReferenceStretch(wanted, speed, (at + 1) * self._row_ns, spring, damper)
