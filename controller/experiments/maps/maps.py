"""Maps the simulated critical stiffness over virtual damping, delay and kick, on many cores.

The settings alone decide how the work is divided into tasks, and each task is independent: the
result does not depend on the number of processes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.kept import Kept
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
    """All that the results of a map depend on.

    Raises:
        ValueError: A value is outside of its domain.
    """

    setting: MapSettings
    dampings: Sequence[float]
    """B [N·m·s/rad]"""
    delay_steps: Sequence[int]
    """Inserted delays in periods"""
    kicks: Sequence[float]
    """[rad]"""
    tolerance: float = TOLERANCE
    """Wanted relative accuracy"""

    def __post_init__(self) -> None:
        """Check the values."""
        for name in ("dampings", "delay_steps", "kicks"):
            values = getattr(self, name)
            if len(values) == 0 or not np.all(np.isfinite(values)):
                raise ValueError(f"{name}: wanted one finite number or more, got {values}")
        if min(self.delay_steps) < 0:
            raise ValueError(f"delay_steps: wanted 0 or more, got {min(self.delay_steps)}")
        if min(self.kicks) <= 0.0 or not self.tolerance > 0.0:
            given = f"{min(self.kicks):g}, {self.tolerance:g}"
            raise ValueError(f"kicks and tolerance: wanted > 0, got {given}")

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

    def part(self, task: Task) -> MapQuestion:
        """Return the settings of one task; they can be sent to another process."""
        dampings = self.dampings[task.first : task.first + task.size]
        return replace(self, dampings=dampings, delay_steps=[self.delay_steps[task.delay]])

    def compute(self) -> FloatArray:
        """Compute a part: critical stiffness at its one delay, dampings × kicks [N·m/rad]."""
        (steps,) = self.delay_steps
        repeated = [damping for damping in self.dampings for _ in self.kicks]
        kicks = np.tile(np.array(self.kicks, dtype=np.float64), len(self.dampings))
        walls = self.setting.walls(repeated, steps)
        found = onset(walls, kicks, self.tolerance, self.setting.servo)
        return found.reshape(len(self.dampings), len(self.kicks))

    def kept(self, path: Path, *, resume: bool, fresh: bool) -> Kept[Task, FloatArray]:
        """Return the file of finished tasks.

        Args:
            path: The file.
            resume: Go on with the tasks of an earlier call.
            fresh: Discard them.

        Raises:
            UserError: See ``Kept``.
        """
        tasks = set(self.tasks())

        def read(line: Any) -> tuple[Task, FloatArray]:  # noqa: ANN401 - JSON
            task, found = Task(*line[0]), np.array(line[1], dtype=np.float64)
            if task not in tasks or found.shape != (task.size, len(self.kicks)):
                raise ValueError("no task of this map")
            if not np.all(found >= 0.0):
                raise ValueError("no stiffness")
            return task, found

        def write(task: Task, found: FloatArray) -> object:
            return [task, found.tolist()]

        return Kept(path, asdict(self), read, write, fresh=fresh, resume=resume)


def _refuse_more(servo: TrueServo, period_ns: int) -> None:
    """Refuse a servo with effects that would be left out.

    Raises:
        UserError: It has such an effect.
    """
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

    @property
    def count(self) -> int:
        """Return the number of computed points."""
        return int(np.count_nonzero(~np.isnan(self.stiffness)))

    @property
    def complete(self) -> bool:
        """Whether every point was computed."""
        return self.count == self.stiffness.size


def critical_map(
    question: MapQuestion,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
    kept: Kept[Task, FloatArray] | None = None,
) -> CriticalMap:
    """Compute the critical stiffness by simulation at every combination; see ``onset``.

    Args:
        question: The settings.
        executor: Computes the tasks, which are picklable; it stays open. None: a process for each
            core, started for this call.
        workers: Number of processes, where there is no executor.
        progress: Called with the progress, in this thread.
        kept: The file of finished tasks.

    Returns:
        The map; after Ctrl-C the part that was finished: tasks that had not begun are cancelled.

    Raises:
        PlatformError: A process started for this call was ended from outside.
        UserError: The file could not be written.
        Exception: An error of a task, or of the caller's executor; the other tasks were cancelled.
    """
    found = _theory(question)

    def fill(task: Task, stiffness: FloatArray) -> None:
        found.stiffness[task.delay, task.first : task.first + task.size] = stiffness

    known = {} if kept is None else kept.done
    for task, stiffness in known.items():
        fill(task, stiffness)
    left = [(task, question.part(task).compute) for task in question.tasks() if task not in known]
    own = processes(min(workers or cores(), len(left) or 1)) if executor is None else None
    with suppress(KeyboardInterrupt), interrupting(), own or nullcontext(executor) as pool:
        assert pool is not None
        with results(pool, left) as computed:
            for task, stiffness in computed:
                fill(task, stiffness)
                if kept is not None:
                    kept.add(task, stiffness)
                if progress is not None:
                    progress(found.count, found.stiffness.size)
    return found


def _theory(question: MapQuestion) -> CriticalMap:
    """Return the map with the theory's limits filled in."""
    setting = question.setting
    damping = np.array(question.dampings, dtype=np.float64)
    steps = np.array(question.delay_steps, dtype=np.int64)
    delay = setting.delay(steps)
    cuts = range(0, damping.size, max(1, _LIMITS // steps.size))
    parts = [_limits(setting, part, delay[:, None]) for part in np.split(damping, cuts[1:])]
    linear, exact, one_sided = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    kick = np.array(question.kicks, dtype=np.float64)
    stiffness = np.full((steps.size, damping.size, kick.size), np.nan)
    return CriticalMap(setting, damping, steps, delay, kick, stiffness, linear, exact, one_sided)


def _limits(
    setting: MapSettings, damping: FloatArray, delay: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the linear, the exact and the one-sided limit, delays × dampings [N·m/rad]."""
    servo, period = setting.servo, setting.period
    loop = (servo, damping, period, delay, setting.velocity_samples)
    linear = linear_limit(servo.damping, damping, period, delay)
    return linear, exact_limit(*loop), one_sided_limit_of(*loop)
