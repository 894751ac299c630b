"""Plans a large map before it starts, from a measured sample: time, memory, room on the disk."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

from haptic_wall.controller.cli.options import say
from haptic_wall.controller.errors import UserError

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.maps.maps import MapQuestion, Task
    from haptic_wall.controller.experiments.maps.store import MapStore

LARGE = 5000
"""Number of points from which a map is planned: a smaller one is done in minutes"""
_USUAL = 250e6
"""Memory of the command before its points, where it cannot be asked [bytes]"""
_DRAWING = 60e6
"""Memory of Matplotlib and of the theory's limits that are computed together [bytes]"""
_POINT = 100.0
"""Memory of a point in arrays, tasks and picture [bytes]"""
_LIMITS_S = 8e-4
"""Approximate time of the theory's limits of one damping and delay, in this process [s]"""
_SAMPLE = 3
"""Number of measured tasks: from the slowest to the quickest"""


@dataclass(frozen=True, slots=True)
class MapPlan:
    """What a map takes."""

    points: int
    seconds: float
    """Time on the given number of processes [s]"""
    memory: float
    """Of this process, the largest [bytes]"""
    size: float
    """Size of the files [bytes]"""

    def __str__(self) -> str:
        return (
            f"{self.points} points take {_span(self.seconds)}, {self.memory / 1e6:.0f} MB of memory"
            f" and {self.size / 1e6:.0f} MB on the disk, estimated from a sample"
        )


def planned(question: MapQuestion, store: MapStore, processes: int) -> MapPlan:
    """Compute some tasks of a map, which are stored, and conclude what all will take.

    Args:
        question: The map.
        store: Its finished tasks.
        processes: Number of them that will compute.
    """
    from haptic_wall.controller.cli.map_files import json_parts, report_of, write_csv
    from haptic_wall.controller.experiments.maps.maps import Task, critical_map

    left = [task for task in question.tasks() if task not in store.done]
    seconds, some, written = 0.0, 0, StringIO()
    for task in _spread(left):
        begun = time.perf_counter()
        found = question.call(task)()
        seconds += time.perf_counter() - begun
        store.add(task, found)
        some += found.size
        part = question.dampings[task.first : task.first + task.size]
        steps = [question.delay_steps[task.delay]]
        known = {Task(0, 0, task.size): found}
        sample = critical_map(question.setting, part, steps, question.kicks, done=known)
        write_csv(sample, written)
        written.writelines(json_parts(sample, report_of(sample, "")))
    rest = sum(task.size for task in left) * len(question.kicks) - some
    share = question.points / max(some, 1)
    time_s = seconds / max(some, 1) * rest / processes
    time_s += _LIMITS_S * len(question.dampings) * len(question.delay_steps)
    memory = _held() + _DRAWING + _POINT * question.points
    return MapPlan(question.points, time_s, memory, share * written.tell())


def _held() -> float:
    """Return the most memory that this process has held [bytes]."""
    if sys.platform != "linux":
        return _USUAL
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024.0 * next(float(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def check_room(folder: Path, made: MapPlan) -> None:
    """Say what the map takes, and refuse one for which there is no room.

    Raises:
        UserError: The files would not fit on the disk.
    """
    say(str(made))
    free = shutil.disk_usage(folder).free
    if made.size > free:
        raise UserError(
            f"found {free / 1e6:.0f} MB free, wanted {made.size / 1e6:.0f} MB for the files",
            field="--out",
            given=folder,
            advice="make room, name another place, or ask for fewer points",
        )


def _spread(tasks: Sequence[Task]) -> list[Task]:
    """Return the first, the last, and some between."""
    if not tasks:
        return []
    last = len(tasks) - 1
    return list(dict.fromkeys(tasks[round(last * k / (_SAMPLE - 1))] for k in range(_SAMPLE)))


def _span(seconds: float) -> str:
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"
