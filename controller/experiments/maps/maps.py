"""Maps the simulated critical stiffness over virtual damping, delay and kick, on many cores.

The settings alone decide how the work is divided into tasks, and each task is independent: the
result does not depend on the number of processes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.maps.limits import exact_limit, one_sided_limit_of
from haptic_wall.controller.experiments.maps.loop import Wall
from haptic_wall.controller.experiments.maps.onset import onset
from haptic_wall.controller.experiments.maps.walls import wall_of
from haptic_wall.controller.experiments.processes import cores, processes, results
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.signals import interrupting
from haptic_wall.controller.theory import linear_limit
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.hw.plant.mechanics import mechanics_of
from haptic_wall.hw.truth import TrueServo

TOLERANCE = 1e-3
"""Default relative accuracy of a map."""
_TASK = 64
"""Largest number of points in a task: more would leave cores idle."""

_LIMITS = 1000
"""Settings whose theoretical limits are computed together: they take some 80 kB each meanwhile"""

Progress = Callable[[int, int], None]
"""Called with the number of finished points, and the total."""


class Task(NamedTuple):
    """A part of a map: some neighbouring virtual dampings at one delay, with every kick."""

    delay: int
    """Its number among the delays"""
    first: int
    """Number of the first virtual damping"""
    size: int
    """Number of virtual dampings"""


Finished = Callable[[Task, FloatArray], None]
"""Called with a task and its stiffnesses, dampings x kicks [N·m/rad]"""


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
        one_sided = config.wall.side != "both"
        servo = config.true_servo()
        _refuse_more(servo, config.period_ns)
        if servo.back_emf and config.servo.kind != "simulated":
            raise UserError(
                "found true for an emulated servo, whose motor a map does not know",
                field="servo.back_emf",
                advice="set servo.backend=simulated, servo.torque_limit and servo.no_load_speed",
            )
        clip = config.wall.torque_clip
        return cls(
            servo,
            config.period_ns,
            one_sided,
            config.wall.velocity_samples,
            math.inf if clip is None else clip,
        )

    @property
    def period(self) -> float:
        """Return the sampling period [s]."""
        return self.period_ns * 1e-9

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
        total_ns = steps * self.period_ns + round(self.servo.delay * 1e9)
        return total_ns.astype(np.float64) * 1e-9

    def walls(self, virtual_damping: Sequence[float], steps: int) -> list[Wall]:
        """Return walls with these virtual dampings and this many inserted periods."""
        delay_ns = steps * self.period_ns + round(self.servo.delay * 1e9)
        wall = wall_of(
            self.servo,
            period=self.period,
            delay=delay_ns * 1e-9,
            virtual_damping=0.0,
            one_sided=self.one_sided,
            velocity_samples=self.velocity_samples,
            limit=self.torque_clip,
        )
        return [wall._replace(virtual_damping=float(damping)) for damping in virtual_damping]


@dataclass(frozen=True, slots=True)
class MapQuestion:
    """All that the results of a map depend on."""

    setting: MapSettings
    dampings: Sequence[float]
    """B [N·m·s/rad]"""
    delay_steps: Sequence[int]
    """Inserted delays in periods"""
    kicks: Sequence[float]
    """[rad]"""
    tolerance: float = TOLERANCE
    """Wanted relative accuracy"""

    @property
    def points(self) -> int:
        """Return the number of points."""
        return len(self.dampings) * len(self.delay_steps) * len(self.kicks)

    def tasks(self) -> list[Task]:
        """Divide the map by its settings alone; return the tasks in the order of their start."""
        size = max(1, _TASK // len(self.kicks))
        # The longest delays, which take longest, come first, so that the cores finish together.
        order = sorted(range(len(self.delay_steps)), key=lambda i: -self.delay_steps[i])
        return [
            Task(i, first, min(size, len(self.dampings) - first))
            for i in order
            for first in range(0, len(self.dampings), size)
        ]

    def call(self, task: Task) -> Callable[[], FloatArray]:
        """Return a call that computes a task, and can be sent to another process."""
        part = np.array(self.dampings[task.first : task.first + task.size], dtype=np.float64)
        kicks = np.array(self.kicks, dtype=np.float64)
        steps = int(self.delay_steps[task.delay])
        return partial(compute, self.setting, part, steps, kicks, self.tolerance)


def _refuse_more(servo: TrueServo, period_ns: int) -> None:
    """Refuse a servo with effects that would be left out.

    Raises:
        UserError: It has such an effect.
    """
    if servo.chain:
        raise UserError(
            f"found {len(servo.chain)} masses behind the output, but a map simulates one load",
            field="servo.chain",
            advice="leave it out, or use haptic-wall sweep",
        )
    tick_ns = round(servo.current_period * 1e9)
    if tick_ns and period_ns % tick_ns:
        raise UserError(
            f"found {servo.current_period:g} s",
            field="servo.current_period",
            wanted=f"the loop's period, {period_ns * 1e-9:g} s, divided by a whole number",
            advice="change it, or use haptic-wall sweep",
        )


@dataclass(frozen=True, slots=True)
class CriticalMap:
    """The simulated critical stiffness, with the theory's limits, arrays of delays × dampings."""

    setting: MapSettings
    virtual_damping: FloatArray
    """B [N·m·s/rad]"""
    delay_steps: IntArray
    """Inserted delay in periods"""
    delay: FloatArray
    """Total delay [s], the servo's own included"""
    kick: FloatArray
    """[rad]"""
    stiffness: FloatArray
    """Simulated, delays × dampings × kicks [N·m/rad]: 0 every motion grows, inf none does, NaN not
    computed"""
    linear: FloatArray
    """Limit of the linear condition [N·m/rad]"""
    exact: FloatArray
    """Exact limit of the two-sided wall without friction [N·m/rad]"""
    one_sided: FloatArray
    """Limit of the wall that never pulls, without friction [N·m/rad]"""

    def fill(self, task: Task, stiffness: FloatArray) -> None:
        """Enter the stiffnesses of a task, dampings x kicks [N·m/rad]."""
        self.stiffness[task.delay, task.first : task.first + len(stiffness)] = stiffness

    @property
    def count(self) -> int:
        """Return the number of computed points."""
        return int(np.count_nonzero(~np.isnan(self.stiffness)))

    @property
    def complete(self) -> bool:
        """Whether every point was computed."""
        return self.count == self.stiffness.size

    @property
    def begun(self) -> bool:
        """Whether any point was computed."""
        return self.count > 0


class MapInterruptedError(KeyboardInterrupt):
    """Ctrl-C, with the finished part of the map.

    Attributes:
        partial: The map; NaN where nothing was computed.
    """

    def __init__(self, partial: CriticalMap) -> None:
        super().__init__()
        self.partial = partial


def critical_map(
    setting: MapSettings,
    virtual_dampings: Sequence[float],
    delay_steps: Sequence[int],
    kicks: Sequence[float],
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
    tolerance: float = TOLERANCE,
    done: Mapping[Task, FloatArray] | None = None,
    finished: Finished | None = None,
) -> CriticalMap:
    """Compute the critical stiffness by simulation at every combination; see ``onset``.

    Args:
        setting: The servo and the loop.
        virtual_dampings: B [N·m·s/rad].
        delay_steps: Whole periods inserted, >= 0.
        kicks: > 0 [rad].
        executor: Computes the tasks, which are picklable; it stays open. None: a process for each
            core, started for this call.
        workers: Number of processes, where there is no executor.
        progress: Called with the progress, in this thread.
        tolerance: Wanted relative accuracy, > 0.
        done: Tasks of an earlier call with the same settings.
        finished: Called with each other task, in this thread.

    Raises:
        ValueError: A value is outside of its domain.
        MapInterruptedError: Ctrl-C; tasks that had not begun were cancelled.
        PlatformError: A process started for this call was ended from outside.
        Exception: An error of a task, or of the caller's executor; the other tasks were cancelled.
    """
    damping = np.array(virtual_dampings, dtype=np.float64)
    steps = np.array(delay_steps, dtype=np.int64)
    kick = np.array(kicks, dtype=np.float64)
    _check(damping, steps, kick, tolerance)
    found = _theory(setting, damping, steps, kick)
    question = MapQuestion(setting, virtual_dampings, delay_steps, kicks, tolerance)
    known = {} if done is None else done
    for task, stiffness in known.items():
        found.fill(task, stiffness)
    left = [(task, question.call(task)) for task in question.tasks() if task not in known]
    points = found.count
    own = processes(min(workers or cores(), len(left) or 1)) if executor is None else None
    try:
        with interrupting(), own or nullcontext(executor) as pool:
            assert pool is not None
            with results(pool, left) as computed:
                for task, stiffness in computed:
                    found.fill(task, stiffness)
                    if finished is not None:
                        finished(task, stiffness)
                    points += stiffness.size
                    if progress is not None:
                        progress(points, found.stiffness.size)
    except KeyboardInterrupt:
        raise MapInterruptedError(found) from None
    return found


def compute(
    setting: MapSettings,
    virtual_damping: FloatArray,
    steps: int,
    kick: FloatArray,
    tolerance: float,
) -> FloatArray:
    """Compute one task: critical stiffness [N·m/rad] at one delay, dampings × kicks."""
    walls = setting.walls(np.repeat(virtual_damping, kick.size).tolist(), steps)
    found = onset(walls, np.tile(kick, virtual_damping.size), tolerance, setting.servo)
    return found.reshape(virtual_damping.size, kick.size)


def _check(damping: FloatArray, steps: IntArray, kick: FloatArray, tolerance: float) -> None:
    for name, array in (("virtual_dampings", damping), ("delay_steps", steps), ("kicks", kick)):
        if array.size == 0 or not np.all(np.isfinite(array)):
            raise ValueError(f"{name}: wanted one finite number or more, got {array.tolist()}")
    if steps.min() < 0:
        raise ValueError(f"delay_steps: wanted 0 or more, got {steps.min()}")
    if kick.min() <= 0.0 or not tolerance > 0.0:
        raise ValueError(f"kicks and tolerance: wanted > 0, got {kick.min():g}, {tolerance:g}")


def _theory(
    setting: MapSettings, damping: FloatArray, steps: IntArray, kick: FloatArray
) -> CriticalMap:
    """Return the map with the theory's limits filled in."""
    delay = setting.delay(steps)
    column = delay[:, None]
    cuts = range(0, damping.size, max(1, _LIMITS // steps.size))
    parts = [_limits(setting, part, column) for part in np.split(damping, cuts[1:])]
    linear, exact, one_sided = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    return CriticalMap(
        setting=setting,
        virtual_damping=damping,
        delay_steps=steps,
        delay=delay,
        kick=kick,
        stiffness=np.full((steps.size, damping.size, kick.size), np.nan),
        linear=linear,
        exact=exact,
        one_sided=one_sided,
    )


def _limits(
    setting: MapSettings, damping: FloatArray, delay: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the linear, the exact and the one-sided limit, delays × dampings [N·m/rad]."""
    servo, period = setting.servo, setting.period
    loop = (servo, damping, period, delay, setting.velocity_samples)
    linear = linear_limit(servo.damping, damping, period, delay)
    return linear, exact_limit(*loop), one_sided_limit_of(*loop)
