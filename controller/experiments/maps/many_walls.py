"""Simulates the whole loop for many walls: encoder, velocity, law, delay, torque limit, servo.

Each wall is simulated to the last bit as the program would run it alone on the simulated clock with
the simulated servo (without guard, safety and operator): the same operations in the same order, on
blocks of walls that fit into the processor's cache. Where Numba is installed, blocks without
further effects and encoder errors run compiled (``compiled``), with equal results.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np

from haptic_wall.controller.experiments.maps import lane_rows
from haptic_wall.controller.experiments.maps.compiled import Lanes, compiled
from haptic_wall.controller.experiments.maps.walls import Walls
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.plant.bodies import Bodies, Held
from haptic_wall.hw.plant.current_loops import STEP_S, CurrentLoops
from haptic_wall.hw.plant.many_two_masses import HeldTwo, ManyTwoMasses, Transmissions

_WORTH = 8
"""Least number of periods that are worth a compiled call: it copies all walls"""
_SNAP = 1e-9  # fraction of a period: a delay this near to a whole number is taken as whole
Over = Held | HeldTwo


class Loops:
    """Simulates a block of similar walls (see ``blocks``) period by period.

    The servos start after a long rest at their positions, without torque, or move freely with a
    velocity; the first velocity estimate is 0, as in the program.

    Args:
        walls: The walls.
        position: Of the servos at the start [rad], shape (n,).
        velocity: At the start [rad/s]; None: 0.
        compile_: Run compiled, where that is possible.

    Attributes:
        bodies: The servos.
        k: Periods simulated.
        lanes: The compiled loop; None: arrays.
        hand: Torque of an operator on each servo, held over each period [N·m]; None: no operator.
    """

    def __init__(
        self,
        walls: Walls,
        position: FloatArray,
        velocity: FloatArray | None = None,
        *,
        compile_: bool = True,
    ) -> None:
        n = walls.size
        velocity = np.zeros(n) if velocity is None else velocity
        self.bodies = _bodies(walls, position, velocity)
        self.k = 0
        self.hand: FloatArray | None = None
        self._walls = walls
        self._samples = int(walls.velocity_samples[0])
        cuts = [0, *(np.flatnonzero(np.diff(walls.whole)) + 1).tolist(), n]
        self._delays = [
            (int(walls.whole[first]), slice(first, last))
            for first, last in itertools.pairwise(cuts)
        ]
        self._acting = np.empty(n)
        self._one_sided = walls.law is None and bool(walls.one_sided[0])
        self._rounded = bool(walls.counts_per_radian[0] > 0.0)
        self._limited = bool(np.isfinite(walls.torque_limit[0]))
        self._stepped = bool(walls.torque_step[0] > 0.0)
        self._play = bool(walls.backlash[0] > 0.0)
        lagging = bool(walls.lag[0] > 0.0)
        loop = walls.current_loop
        self._current = None if loop is None else CurrentLoops(loop, velocity)
        self._late = self._over(walls.lag) if lagging else None
        self._held = self._over(walls.rest)
        self._half = 0.5 * walls.backlash
        self._followed = position.copy()
        # Measured positions and commanded torques: ring buffers with a row per period.
        self._measured = np.empty((self._samples + 2, n))
        self._torques = np.zeros((int(walls.whole.max()) + 2, n))
        self._minus_stiffness, self._minus_limit = -walls.stiffness, -walls.torque_limit
        self._estimate, self._outside = np.empty(n), np.empty(n, dtype=np.bool_)
        self._errors = walls.encoder
        self._period_ns = np.rint(walls.period * 1e9).astype(np.int64)
        self._separate = self._rounded or self._play or self._errors is not None
        self._separate |= walls.transmission is not None
        if not self._separate:
            self._measured[0] = position
            self.bodies.position = self._measured[0]
        self.lanes = self._in_lanes() if compile_ else None

    def _in_lanes(self) -> Lanes | None:
        """Return the compiled loop of these walls; None: they have what it lacks, or no Numba."""
        walls = self._walls
        if walls.effects is not None or walls.encoder is not None:
            return None
        run = compiled()
        if run is None:
            return None
        fixed = np.zeros((lane_rows.FIXED, walls.size))
        fixed[lane_rows.INERTIA] = walls.inertia
        fixed[lane_rows.DECAY] = walls.damping / walls.inertia
        fixed[lane_rows.COULOMB] = walls.coulomb
        fixed[lane_rows.FRICTION] = walls.coulomb / walls.inertia
        fixed[lane_rows.COUNTS] = walls.counts_per_radian
        fixed[lane_rows.HALF] = self._half
        fixed[lane_rows.LIMIT] = walls.torque_limit
        fixed[lane_rows.STEP] = walls.torque_step
        fixed[lane_rows.SOFTNESS] = self._minus_stiffness
        fixed[lane_rows.VIRTUAL] = walls.virtual_damping
        fixed[lane_rows.PERIOD] = walls.period
        fixed[lane_rows.FULL] = walls.torque_limit - walls.torque_step
        fixed[lane_rows.GONE] = walls.whole + 2
        traits = {
            lane_rows.ONE_SIDED: self._one_sided,
            lane_rows.IS_LIMITED: self._limited,
            lane_rows.STEPPED: self._stepped,
            lane_rows.ROUNDED: self._rounded,
            lane_rows.PLAY: self._play,
            lane_rows.FRICTIONAL: bool((walls.coulomb > 0.0).any()),
            lane_rows.LAGS: self._late is not None,
            lane_rows.SAMPLES: self._samples,
        }
        loads = drives = None
        if walls.transmission is not None:
            loads = self._loads(walls.transmission)
        if self._current is not None:
            drives = np.zeros((lane_rows.DRIVES, walls.size))
            drives[: lane_rows.SHARES] = self._current.parameters
        for part, (over, whole) in enumerate(((self._late, walls.lag), (self._held, walls.rest))):
            if isinstance(over, Held):
                row = (lane_rows.LATE, lane_rows.HELD)[part]
                fixed[row : row + 4] = over
            elif over is not None:
                assert loads is not None
                row = lane_rows.RESPONSES + part * lane_rows.RESPONSE
                loads[row : row + 16] = over.slide.reshape(16, -1)
                loads[row + 16 : row + 20] = over.stick.reshape(4, -1)
                loads[row + 20] = over.duration / over.parts
                traits[lane_rows.PARTS + part] = over.parts
            if self._current is not None and over is not None:
                assert drives is not None
                traits[lane_rows.STEPS + part] = _steps(whole)
                row = lane_rows.SHARES + 2 * part
                drives[row : row + 2] = self._current.shares(over.duration)
        delays = [(whole, part.start, part.stop) for whole, part in self._delays]
        law = walls.law
        table = None
        if law is not None:
            table = np.array([law.positions, law.elongations])
            traits[lane_rows.IN_CONTACT] = not law.everywhere
        each = np.array(delays, dtype=np.int64)
        return Lanes(run, traits, each, fixed, loads, drives, table)

    def _loads(self, transmission: Transmissions) -> FloatArray:
        """Return what does not change of servos with a load; the responses are still missing."""
        loads = np.zeros((lane_rows.LOADS, self._walls.size))
        loads[lane_rows.LOAD] = transmission.load_inertia
        loads[lane_rows.SPRING] = transmission.stiffness
        loads[lane_rows.LOSS] = transmission.damping
        loads[lane_rows.VISCOUS] = self._walls.damping
        loads[lane_rows.ON_MOTOR] = transmission.on_motor
        return loads

    def run(
        self,
        periods: int,
        watch: Callable[[], None] | None = None,
        at_switch: Callable[[], None] | None = None,
    ) -> None:
        """Simulate some periods.

        Args:
            periods: Number of periods.
            watch: Called after each.
            at_switch: Called where the torque changes within a period, if it does.
        """
        alone = watch is None and at_switch is None and not self._pushed
        if self.lanes is not None and alone and periods >= _WORTH:
            self._run_in_lanes(periods)
            return
        for _ in range(periods):
            self._period(at_switch)
            if watch is not None:
                watch()

    def run_watched(
        self, periods: int, observer: int, seen: FloatArray, turned: FloatArray | None = None
    ) -> int:
        """Simulate some periods in ``lanes``, where there are, with an observer of theirs.

        Args:
            periods: Number of periods.
            observer: ``lane_rows.TURNINGS`` or ``lane_rows.CONTACTS``.
            seen: Its memory, from ``Lanes.seen``.
            turned: Gets the turning points, shape (5, room); see ``lanes.run``.

        Returns:
            The number of turning points.
        """
        return self._run_in_lanes(periods, observer=observer, seen=seen, turned=turned)

    def driven(self, hands: FloatArray) -> FloatArray:
        """Simulate as many periods as there are rows of an operator's torques [N·m], (periods, n).

        Returns:
            The positions at the ends of the periods [rad], same shape.
        """
        course = np.empty(hands.shape)
        if self.lanes is not None and self._current is None:
            self._run_in_lanes(len(hands), hands=hands, course=course)
            return course
        for given, position in zip(hands, course, strict=True):
            self.hand = given
            self.run(1)
            position[:] = self.bodies.position
        return course

    def _run_in_lanes(
        self,
        periods: int,
        *,
        observer: int = lane_rows.NOBODY,
        seen: FloatArray | None = None,
        turned: FloatArray | None = None,
        hands: FloatArray | None = None,
        course: FloatArray | None = None,
    ) -> int:
        assert self.lanes is not None
        bodies = self.bodies
        body = np.stack([bodies.position, bodies.velocity, self._followed])
        if not self._play:
            body[2] = body[0]
        if hands is None and self.hand is not None:
            hands = self.hand[None, :]
        count = self.lanes.run(
            self.k,
            periods,
            body,
            self._measured,
            self._torques,
            hands=hands,
            observer=observer,
            seen=seen,
            turned=turned,
            course=course,
            masses=bodies.state if isinstance(bodies, ManyTwoMasses) else None,
            currents=None if self._current is None else self._current.state,
        )
        self.k += periods
        if not self._separate:  # the next measured position
            bodies.position = self._measured[self.k % self._measured.shape[0]]
        np.copyto(bodies.position, body[0])
        np.copyto(bodies.velocity, body[1])
        if self._play:
            np.copyto(self._followed, body[2])
        elif self._separate:
            self._followed = bodies.position
        return count

    @property
    def _pushed(self) -> bool:
        """Whether an operator pushes behind current loops, which run in arrays then."""
        return self.hand is not None and self._current is not None

    @property
    def walls(self) -> Walls:
        """Return the simulated walls."""
        return self._walls

    @property
    def torque(self) -> FloatArray:
        """Return the last commanded torque, after limit and rounding [N·m]."""
        row: FloatArray = self._torques[(self.k - 1) % self._torques.shape[0]]
        return row

    @property
    def measured(self) -> FloatArray:
        """Return the last measured position [rad]."""
        row: FloatArray = self._measured[(self.k - 1) % self._measured.shape[0]]
        return row

    def _period(self, at_switch: Callable[[], None] | None) -> None:
        k, torques, rows = self.k, self._torques, self._measured.shape[0]
        measured = self._measured[k % rows]
        errors, seen = self._errors, self._followed
        if errors is not None:
            seen = errors.position(seen)
        if self._rounded:
            np.multiply(seen, self._walls.counts_per_radian, measured)
            if errors is not None:
                np.add(measured, errors.noise_at(k * self._period_ns), measured)
            np.rint(measured, measured)
            np.divide(measured, self._walls.counts_per_radian, measured)
        elif self._separate:
            np.copyto(measured, seen)
        self._command(measured, torques[k % torques.shape[0]])
        out = None if self._separate else self._measured[(k + 1) % rows]
        if self._late is not None:
            self._move(self._delayed(1), self._late, self._walls.lag, out)
            out = None
            if at_switch is not None:
                at_switch()
        self._move(self._delayed(0), self._held, self._walls.rest, out)
        self.k = k + 1

    def _over(self, duration: FloatArray) -> Over:
        """Return the responses over this time; with current loops over a step of it."""
        return self.bodies.held(duration if self._current is None else duration / _steps(duration))

    def _delayed(self, more: int) -> FloatArray:
        """Return the torques commanded each wall's whole periods of delay, and ``more``, ago."""
        torques, now = self._torques, self.k - more
        if len(self._delays) == 1:
            row: FloatArray = torques[(now - self._delays[0][0]) % torques.shape[0]]
            return row
        for whole, part in self._delays:
            self._acting[part] = torques[(now - whole) % torques.shape[0], part]
        return self._acting

    def _command(self, measured: FloatArray, torque: FloatArray) -> None:
        """Store the wall's torque, limited and rounded, in ``torque``."""
        walls, estimate = self._walls, self._estimate
        back = min(self.k, self._samples)
        law = walls.law
        away = measured if law is None else law.elongation(measured)
        np.multiply(self._minus_stiffness, away, torque)
        if back:
            earlier = self._measured[(self.k - back) % self._measured.shape[0]]
            np.subtract(measured, earlier, estimate)
            over = walls.period if back == 1 else back * walls.period
            np.divide(estimate, over, estimate)
            np.multiply(walls.virtual_damping, estimate, estimate)
            np.subtract(torque, estimate, torque)
        if law is not None and not law.everywhere:
            torque[(away == 0.0) | (away * torque >= 0.0)] = 0.0
        if self._one_sided:
            np.minimum(torque, 0.0, out=torque)
            np.less_equal(measured, 0.0, self._outside)
            np.copyto(torque, 0.0, where=self._outside)
        if self._limited:
            np.maximum(torque, self._minus_limit, out=torque)
            np.minimum(torque, walls.torque_limit, out=torque)
        if self._stepped:
            np.divide(torque, walls.torque_step, torque)
            np.rint(torque, torque)
            np.multiply(torque, walls.torque_step, estimate)
            np.absolute(estimate, estimate)
            beyond = estimate > walls.torque_limit
            torque[beyond] -= np.copysign(1.0, torque[beyond])
            np.multiply(torque, walls.torque_step, torque)

    def _move(
        self, torque: FloatArray, over: Over, duration: FloatArray, out: FloatArray | None
    ) -> None:
        """Move for ``duration`` [s] under commanded torques."""
        if self._current is None:
            self._step(torque, over, out)
            return
        for _ in range(_steps(duration)):
            acting = self._current.held(torque, self.bodies.motor_velocity, over.duration)
            self._step(acting, over, out)
            out = None

    def _step(self, torque: FloatArray, over: Over, out: FloatArray | None) -> None:
        bodies, followed = self.bodies, self._followed
        outside = 0.0 if self.hand is None else self.hand
        if isinstance(bodies, ManyTwoMasses):
            assert isinstance(over, HeldTwo)
            bodies.step(torque, over, outside)
            self._followed = bodies.position
            return
        assert isinstance(over, Held)
        if not self._play:
            bodies.step(torque, over, out, outside)
            if self._separate:
                self._followed = bodies.position
            return
        for index, turn in bodies.step_turning(torque, over, out, outside):
            half = self._half[index]
            followed[index] = np.minimum(np.maximum(followed[index], turn - half), turn + half)
        np.subtract(bodies.position, self._half, self._estimate)
        np.maximum(followed, self._estimate, out=followed)
        np.add(bodies.position, self._half, self._estimate)
        np.minimum(followed, self._estimate, out=followed)


def _bodies(walls: Walls, position: FloatArray, velocity: FloatArray) -> Bodies | ManyTwoMasses:
    """Return the servos of walls.

    Raises:
        ValueError: A value is out of range, or they have a load and what it leaves out.
    """
    parts = (walls.inertia, walls.damping, walls.coulomb)
    if walls.transmission is None:
        return Bodies(*parts, position, velocity, walls.effects)
    if walls.effects is not None or walls.backlash.any():
        raise ValueError("servos with a transmission have backlash or effects; give none of them")
    return ManyTwoMasses(*parts, walls.transmission, position, velocity)


def _steps(duration: FloatArray) -> int:
    """Return the number of steps into which all divide their time [s]."""
    return max(1, math.ceil(float(duration.max()) / STEP_S - _SNAP))
