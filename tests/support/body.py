"""Moves the body of a trial's servo: one mass, or two with a flexible transmission between.

The motion is computed in short steps of equal length (half a drift, a change of speed, half a
drift: second order). Viscous friction and the operator's damper use the mean speed of a step.
Coulomb friction sticks exactly: a step in which the speed reaches zero is divided there.

Error of the output after 0.4 s and 1 rad of a wild motion, in counts of 4096: rigid 0.002; two
masses at 30 Hz 0.02, with a backlash of 0.5 degrees inside the transmission 0.3. The tests compare
it with the exact solution of ``haptic_wall.hw.plant.step`` and with a general solver.
"""

from __future__ import annotations

import math

from tests.support.operators import NOTHING, Row
from tests.support.truth import Truth

RIGID_STEP_S = 5e-4
"""Longest step of a rigid servo [s]: exact between changes of friction, except for the operator's
slow spring."""
FLEXIBLE_STEP_S = 2.5e-4
"""Longest step with a transmission [s]: a mode of 60 Hz is 0.04 % too fast."""


class Body:
    """State of a servo's body, and its motion.

    Attributes:
        position: Position of the output [rad].
        velocity: Velocity of the output [rad/s].
        motor_position: Position of the motor's side [rad]; the output's where it is rigid.
        motor_velocity: [rad/s]
        followed: Position of the encoder's side of its backlash [rad].
        torque: Torque of the motor, without the effect of back-EMF [N·m].
        mass: Mass that an operator adds to the output [kg·m²].
    """

    def __init__(
        self, truth: Truth, position: float, velocity: float, step_s: float | None
    ) -> None:
        """Create a body without torque and operator.

        Args:
            truth: Its true parameters.
            position: Position of both masses [rad]; the encoder is in the middle of its backlash.
            velocity: Velocity of both masses [rad/s].
            step_s: Longest step of the computation [s]; None: the usual one.
        """
        self.truth = truth
        self.position = self.motor_position = self.followed = position
        self.velocity = self.motor_velocity = velocity
        self.torque = self.mass = 0.0
        self._flexible = truth.flexible
        self._on_motor = truth.flexible and truth.encoder == "motor"
        self._half_backlash = 0.5 * truth.backlash
        own = 1.0 - truth.load_friction if truth.flexible else 1.0
        self._load = truth.load_inertia
        self._motor = truth.inertia - truth.load_inertia
        self._coulomb, self._load_coulomb = own * truth.coulomb, (1.0 - own) * truth.coulomb
        self._viscous, self._load_viscous = own * truth.damping, (1.0 - own) * truth.damping
        self._braking = 0.0 if truth.back_emf == "none" else truth.braking
        self._stall = truth.stall_torque if truth.back_emf == "current" else 0.0
        if truth.back_emf == "voltage":
            self._viscous += truth.braking
        self._spring, self._damper, self._wanted, self._speed, self._push = NOTHING
        usual = FLEXIBLE_STEP_S if truth.flexible else RIGID_STEP_S
        self._longest_ns = round((usual if step_s is None else step_s) * 1e9)
        self._plans: dict[int, tuple[int, float, float]] = {}

    def take(self, row: Row) -> None:
        """Use the operator's forces from now on."""
        self._spring, self._damper, self._wanted, self._speed, self._push = row

    def move(self, length_ns: int) -> None:
        """Move for so long [ns] with the present torque and operator."""
        plan = self._plans.get(length_ns)
        if plan is None:
            plan = self._plans[length_ns] = self._plan(length_ns)
        if self._flexible:
            self._move_two(*plan)
        else:
            self._move_one(*plan)

    def _plan(self, length_ns: int) -> tuple[int, float, float]:
        """Return a stretch's number of steps, their length [s], and a factor on forces [1].

        The transmission's damper uses the mean relative speed of a step; the factor contains its
        effect on the transmitted torque, solved in advance.
        """
        steps = -(-length_ns // self._longest_ns)
        step = length_ns * 1e-9 / steps
        if not self._flexible:
            return steps, step, 1.0
        reduced = self._motor * self._load / (self._motor + self._load)
        return steps, step, 1.0 / (1.0 + 0.5 * self.truth.transmission_damping * step / reduced)

    # Inlined for speed: every trial does this in every period.
    def _move_one(self, steps: int, step: float, _: float) -> None:  # noqa: PLR0912
        """Move a rigid servo by ``steps`` of ``step`` [s]."""
        x, v = self.position, self.velocity
        half = 0.5 * step
        spring, speed, wanted = self._spring, self._speed, self._wanted
        torque, coulomb = self.torque, self._coulomb
        drag = self._viscous + self._damper
        base = torque + self._push + self._damper * speed
        inertia = self._motor + self.mass
        gain = step / (inertia + half * drag)
        stall, braking = self._stall, self._braking
        if stall:
            braked = step / (inertia + half * (drag + braking))
        slack, followed = self._half_backlash, self.followed
        wanted += speed * half
        for _ in range(steps):
            x += v * half
            force = base + spring * (wanted - x) - drag * v
            change = gain
            if stall:
                room = stall - braking * v
                if torque > room:
                    force += room - torque
                    change = braked
                elif torque < room - 2.0 * stall:
                    force += room - 2.0 * stall - torque
                    change = braked
            if v > 0.0:
                new = v + (force - coulomb) * change
                if new <= 0.0:
                    new, shift = _through_rest(v, force, drag, coulomb, change, step)
                    x += shift
            elif v < 0.0:
                new = v + (force + coulomb) * change
                if new >= 0.0:
                    new, shift = _through_rest(v, force, drag, coulomb, change, step)
                    x += shift
            elif force > coulomb:
                new = (force - coulomb) * change
            elif force < -coulomb:
                new = (force + coulomb) * change
            else:
                new = 0.0
            x += new * half
            v = new
            wanted += speed * step
            if slack:
                if followed < x - slack:
                    followed = x - slack
                elif followed > x + slack:
                    followed = x + slack
        self.position = self.motor_position = x
        self.velocity = self.motor_velocity = v
        self._wanted = wanted - speed * half
        self.followed = followed if slack else x

    def _move_two(self, steps: int, step: float, left: float) -> None:  # noqa: PLR0912
        """Move motor and load by ``steps`` of ``step`` [s]."""
        x, v = self.motor_position, self.motor_velocity
        y, w = self.position, self.velocity
        half = 0.5 * step
        spring, speed, wanted = self._spring, self._speed, self._wanted
        torque, coulomb, load_coulomb = self.torque, self._coulomb, self._load_coulomb
        drag, load_drag = self._viscous, self._load_viscous + self._damper
        base = self._push + self._damper * speed
        gain = step / (self._motor + half * drag)
        load_gain = step / (self._load + self.mass + half * load_drag)
        stall, braking = self._stall, self._braking
        if stall:
            braked = step / (self._motor + half * (drag + braking))
        stiffness = left * self.truth.transmission_stiffness
        damper = left * self.truth.transmission_damping
        # The damper's torque for the relative speed that the torques add in half a step.
        added = damper * half * (torque / self._motor - base / (self._load + self.mass))
        gap = 0.5 * self.truth.transmission_backlash
        slack, followed, on_motor = self._half_backlash, self.followed, self._on_motor
        wanted += speed * half
        for _ in range(steps):
            x += v * half
            y += w * half
            twist = x - y
            if gap:
                if twist > gap:
                    # In contact it only pushes: the damper never pulls.
                    passed = stiffness * (twist - gap) + damper * (v - w) + added
                    passed = max(passed, 0.0)
                elif twist < -gap:
                    passed = stiffness * (twist + gap) + damper * (v - w) + added
                    passed = min(passed, 0.0)
                else:
                    passed = 0.0
            else:
                passed = stiffness * twist + damper * (v - w) + added

            force = torque - passed - drag * v
            change = gain
            if stall:
                room = stall - braking * v
                if torque > room:
                    force += room - torque
                    change = braked
                elif torque < room - 2.0 * stall:
                    force += room - 2.0 * stall - torque
                    change = braked
            if v > 0.0:
                new = v + (force - coulomb) * change
                if new <= 0.0:
                    new, shift = _through_rest(v, force, drag, coulomb, change, step)
                    x += shift
            elif v < 0.0:
                new = v + (force + coulomb) * change
                if new >= 0.0:
                    new, shift = _through_rest(v, force, drag, coulomb, change, step)
                    x += shift
            elif force > coulomb:
                new = (force - coulomb) * change
            elif force < -coulomb:
                new = (force + coulomb) * change
            else:
                new = 0.0
            v = new
            x += v * half

            force = base + passed + spring * (wanted - y) - load_drag * w
            if not load_coulomb:
                w += force * load_gain
            elif w:
                new = w + (force - math.copysign(load_coulomb, w)) * load_gain
                if new * w <= 0.0:
                    new, shift = _through_rest(w, force, load_drag, load_coulomb, load_gain, step)
                    y += shift
                w = new
            elif abs(force) > load_coulomb:
                w = (force - math.copysign(load_coulomb, force)) * load_gain
            y += w * half
            wanted += speed * step
            if slack:
                seen = x if on_motor else y
                if followed < seen - slack:
                    followed = seen - slack
                elif followed > seen + slack:
                    followed = seen + slack
        self.motor_position, self.motor_velocity = x, v
        self.position, self.velocity = y, w
        self._wanted = wanted - speed * half
        self.followed = followed if slack else x if on_motor else y


def _through_rest(
    speed: float, force: float, drag: float, coulomb: float, change: float, step: float
) -> tuple[float, float]:
    """Return the speed after a step through zero, and the error of the mean speed's motion.

    Args:
        speed: Speed at the start of the step, not 0 [rad/s].
        force: Without Coulomb friction, viscous friction counted [N·m].
        drag: Viscous friction [N·m·s/rad].
        coulomb: Coulomb friction [N·m].
        change: Change of the speed, per force [rad/s per N·m].
        step: [s]

    Returns:
        Speed at the end [rad/s]; correction of the position [rad].
    """
    against = force - math.copysign(coulomb, speed)
    before = min(max(-speed / (against * change), 0.0), 1.0) if against else 1.0
    left = 1.0 - before
    at_rest = force + drag * speed
    end = 0.0
    if abs(at_rest) > coulomb:
        end = (at_rest - math.copysign(coulomb, at_rest)) * change * left
    return end, -0.5 * step * (speed * left + end * before)
