"""Maps the simulated critical stiffness over virtual damping, delay and kick, on many cores.

The settings alone decide how the work is divided into tasks, and each task is independent: the
result does not depend on the number of processes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext, suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptic_wall.controller.experiments.kept import Kept
from haptic_wall.controller.experiments.maps.loop import Wall
from haptic_wall.controller.experiments.maps.servo import MapSettings
from haptic_wall.controller.experiments.maps.walls import critical
from haptic_wall.controller.experiments.processes import cores, processes, results
from haptic_wall.controller.system.signals import interrupting
from haptic_wall.controller.theory.checks import FloatArray, IntArray

TOLERANCE = 1e-3
"""Default relative accuracy of a map."""
_LIMITS = 1000
"""Settings whose theoretical limits are computed together: they take some 80 kB each meanwhile"""

Progress = Callable[[int, int], None]
"""Called with the number of finished points, and the total."""


class Task(NamedTuple):
    """A part of a map: one virtual damping at one delay, with every kick."""

    delay: int
    """Its number among the delays"""
    damping: int
    """Its number among the virtual dampings"""


@dataclass(frozen=True, slots=True)
class MapQuestion:
    """All that the results of a map depend on: values that the command has checked."""

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
        """Return the parts of the map in the order of their start."""
        # The longest delays, which take longest, come first, so that the cores finish together.
        order = sorted(range(len(self.delay_steps)), key=lambda i: -self.delay_steps[i])
        return [Task(i, j) for i in order for j in range(len(self.dampings))]

    def compute(self, task: Task) -> Callable[[], FloatArray]:
        """Return what computes a task's critical stiffness at each kick [N·m/rad]; picklable."""
        wall = self.setting.wall(self.dampings[task.damping], self.delay_steps[task.delay])
        return partial(_computed, self.setting, wall, tuple(self.kicks), self.tolerance)

    def kept(self, path: Path, *, fresh: bool) -> Kept[Task, FloatArray]:
        """Return the file of finished tasks.

        Args:
            path: The file.
            fresh: Discard them.

        Raises:
            UserError: See ``Kept``.
        """
        tasks = set(self.tasks())

        def read(line: Any) -> tuple[Task, FloatArray]:  # noqa: ANN401 - JSON
            task, found = Task(*line[0]), np.array(line[1], dtype=np.float64)
            if task not in tasks or found.shape != (len(self.kicks),) or not np.all(found >= 0.0):
                raise ValueError("no task of this map, or no stiffness")
            return task, found

        def write(task: Task, found: FloatArray) -> object:
            return [task, found.tolist()]

        return Kept(path, asdict(self), read, write, fresh=fresh)


def _computed(
    setting: MapSettings, wall: Wall, kicks: Sequence[float], tolerance: float
) -> FloatArray:
    delay = wall.whole * wall.period + wall.lag
    guess = float(setting.loop.critical(wall.virtual_damping, delay).stiffness)
    return np.array([critical(wall, kick, guess, tolerance, setting.servo) for kick in kicks])


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
    """Compute the critical stiffness by simulation at every combination.

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
    known = {} if kept is None else kept.done
    for task, stiffness in known.items():
        found.stiffness[task] = stiffness
    left = [(task, question.compute(task)) for task in question.tasks() if task not in known]
    own = processes(min(workers or cores(), len(left) or 1)) if executor is None else None
    with suppress(KeyboardInterrupt), interrupting(), own or nullcontext(executor) as pool:
        assert pool is not None
        with results(pool, left) as computed:
            for task, stiffness in computed:
                found.stiffness[task] = stiffness
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
    parts = [setting.limits(part, delay) for part in np.split(damping, cuts[1:])]
    linear, exact, one_sided = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    kick = np.array(question.kicks, dtype=np.float64)
    stiffness = np.full((steps.size, damping.size, kick.size), np.nan)
    return CriticalMap(setting, damping, steps, delay, kick, stiffness, linear, exact, one_sided)
