"""Stores a map's finished tasks in a file, so that an interrupted map can go on."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.kept_folder import fingerprint, plainly, refused
from haptic_wall.controller.experiments.maps.maps import MapQuestion, Task
from haptic_wall.controller.system.json_text import RESULT_MARK
from haptic_wall.controller.theory.checks import FloatArray

ROWS = "map.rows"
_FORMAT: Final = "haptic-wall map rows 1"


class MapStore:
    """The finished tasks of a map: read at the start, and added to the file one by one.

    The first line of the file names the map; each other line is a task and its stiffnesses,
    dampings x kicks [N·m/rad]. A line that was cut short when the program was killed is dropped.

    Args:
        folder: There already.
        question: The map.
        resume: Keep what an earlier call has computed for it.
        force: Discard an unfinished map.

    Attributes:
        done: Stiffnesses by task.

    Raises:
        UserError: There is an unfinished map and ``resume`` is not given, or it is of other
            settings; or the file is not what this program writes, or cannot be written.
    """

    def __init__(self, folder: Path, question: MapQuestion, *, resume: bool, force: bool) -> None:
        self._folder = folder
        self._question = question
        self._resume, self._force = resume, force
        self._during = ExitStack()
        self.done: dict[Task, FloatArray] = {}

    def __enter__(self) -> MapStore:
        with ExitStack() as during:
            try:
                file = during.enter_context(open(self._folder / ROWS, "a+b", opener=plainly))
                self._file = file
                self._begin()
            except OSError as error:
                raise self._unwritable(error) from error
            self._during = during.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file, and remove it if it holds no task."""
        self._during.close()
        if not self.done:
            self.remove()

    def _begin(self) -> None:
        """Read what is there, and leave the lines that go on."""
        self._file.seek(0)
        lines = self._file.read().splitlines(keepends=True)
        whole = lines if not lines or lines[-1].endswith(b"\n") else lines[:-1]
        if len(whole) > 1 and not (self._resume or self._force):
            what = "found an unfinished map there"
            advice = "give --resume to continue it, or --force to replace it"
            raise refused(self._folder, what, advice)
        described = fingerprint(asdict(self._question))
        head = {**RESULT_MARK, "format": _FORMAT, "fingerprint": described}
        if self._resume and whole:
            self._read(whole, head)
        else:
            whole = []
        self._file.truncate(sum(map(len, whole)))
        if not whole:
            self._append(head)

    def add(self, task: Task, stiffness: FloatArray) -> None:
        """Store one more task.

        Raises:
            UserError: It cannot be written.
        """
        self.done[task] = stiffness
        try:
            self._append([task, stiffness.tolist()])
        except OSError as error:
            raise self._unwritable(error) from error

    def remove(self) -> None:
        """Remove the file, where the whole map is written."""
        (self._folder / ROWS).unlink(missing_ok=True)

    def _append(self, line: object) -> None:
        self._file.write(_line(line))
        self._file.flush()

    def _read(self, lines: list[bytes], head: Mapping[str, Any]) -> None:
        advice = "name another folder, or give --force to replace it"
        if lines[0] != _line(head):
            raise refused(self._folder, "found an unfinished map with other settings there", advice)
        tasks, kicks = set(self._question.tasks()), len(self._question.kicks)
        for number, line in enumerate(lines[1:], 2):
            try:
                place, stiffness = json.loads(line)
                task, found = Task(*place), np.array(stiffness, dtype=np.float64)
                right = task in tasks and found.shape == (task.size, kicks)
                right = right and bool(np.all(found >= 0.0))
            except (ValueError, TypeError, RecursionError):
                right = False
            if not right:
                raise refused(
                    self._folder, f"{ROWS}, line {number}: found no task of this map", advice
                )
            self.done[task] = found

    def _unwritable(self, error: OSError) -> UserError:
        what = f"{ROWS} cannot be written: {error.strerror or error}"
        return refused(self._folder, what, "make room, or name another place")


def _line(content: object) -> bytes:
    return json.dumps(content).encode() + b"\n"
