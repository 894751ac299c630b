"""A sweep's folder: stores the measured points; only the same settings may continue it."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import TypeAdapter, ValidationError

from haptic_wall import __version__
from haptic_wall.controller.experiments.kept_folder import (
    fingerprint,
    first_wrong,
    kept_bytes,
    made,
    refused,
    replaced,
)
from haptic_wall.controller.experiments.sweep.plan import Options, PlanePoint
from haptic_wall.controller.experiments.sweep.result import PointResult
from haptic_wall.controller.settings.config import Config

JSON, CSV, PNG, LOGS = "sweep.json", "sweep.csv", "sweep.png", "logs"
_FORMAT: Final = "haptic-wall sweep 1"


@dataclass(frozen=True, slots=True)
class _Head:
    """The identity of a stored sweep."""

    format: Literal["haptic-wall sweep 1"]
    program: str
    fingerprint: str
    summary: str
    """For people"""


@dataclass(frozen=True, slots=True)
class _Points:
    """The measured points."""

    points: list[PointResult]


_HEAD, _POINTS = TypeAdapter(_Head), TypeAdapter(_Points)


@dataclass(frozen=True, slots=True)
class SweepSettings:
    """All settings on which a sweep's results depend."""

    config: Config
    settings: tuple[PlanePoint, ...]
    options: Options

    @property
    def fingerprint(self) -> str:
        """Return a text that differs when any setting does, or the program's version."""
        return fingerprint(
            {
                "config": self.config.model_dump(mode="json"),
                "settings": [asdict(setting) for setting in self.settings],
                "options": asdict(self.options),
            }
        )


class SweepStore:
    """Stores the finished points, after each of them.

    Args:
        folder: Made if necessary.
        asked: The requested sweep.
        fresh: Discard an earlier sweep.

    Attributes:
        done: Results by point.

    Raises:
        UserError: The folder holds a sweep of other settings, or cannot be used.
    """

    def __init__(self, folder: Path, asked: SweepSettings, fresh: bool) -> None:
        self.folder = folder
        self._asked = asked
        self.done: dict[PlanePoint, PointResult] = {}
        made(folder, LOGS)
        path = folder / JSON
        if os.path.lexists(path) and not fresh:
            self._resume(path)

    def _resume(self, path: Path) -> None:
        again = "name another folder, or give --fresh to replace it"
        text = kept_bytes(path, again)
        try:
            held = _HEAD.validate_json(text, strict=True)
        except ValidationError:
            what = f"found a {JSON} that haptic-wall did not write"
            raise refused(self.folder, what, again) from None
        if held.fingerprint != self._asked.fingerprint:
            raise refused(
                self.folder,
                f"found a sweep with other settings ({held.summary}, {held.program})",
                "name another folder, or give --fresh to replace it",
            )
        try:
            points = _POINTS.validate_json(text, strict=True).points
        except ValidationError as error:
            what = f"found a {JSON} that this program cannot have written ({first_wrong(error)})"
            raise refused(self.folder, what, again) from None
        for point in points:
            self.done[PlanePoint(point.virtual_damping, point.delay_steps)] = point

    def add(self, setting: PlanePoint, result: PointResult) -> None:
        """Store one more point; the file on disk is never partial.

        Raises:
            UserError: It cannot be written.
        """
        self.done[setting] = result
        self.write()

    @property
    def complete(self) -> bool:
        """Whether every point is done."""
        return all(setting in self.done for setting in self._asked.settings)

    def points(self) -> list[PointResult]:
        """Return the finished points in the requested order."""
        return [self.done[s] for s in self._asked.settings if s in self.done]

    def report(self, name: str) -> dict[str, Any]:
        """Return the content of ``sweep.json`` without the keys that only a later sweep needs."""
        config = self._asked.config
        return {
            "name": name,
            "servo": config.servo.kind,
            "clock": config.loop.clock,
            "period_s": config.period_s,
            "complete": self.complete,
            "points": [asdict(point) for point in self.points()],
        }

    def write(self) -> None:
        """Write table and results.

        Raises:
            UserError: They cannot be written.
        """
        try:
            self._write()
        except OSError as error:
            what = f"cannot be written: {error.strerror or error}"
            raise refused(self.folder, what, "make room, or name another place") from error

    def _write(self) -> None:
        points = [asdict(point) for point in self.points()]
        held: Mapping[str, Any] = {
            "format": _FORMAT,
            "program": f"haptic-wall {__version__}",
            "fingerprint": self._asked.fingerprint,
            "summary": _summary(self._asked),
            "complete": self.complete,
            "config": self._asked.config.model_dump(mode="json"),
            "points": points,
        }
        with replaced(self.folder / JSON) as stream:
            stream.write(json.dumps(held, indent=2, allow_nan=False) + "\n")
        with replaced(self.folder / CSV) as stream:
            writer = csv.DictWriter(stream, [part.name for part in fields(PointResult)])
            writer.writeheader()
            writer.writerows({key: _cell(value) for key, value in row.items()} for row in points)


def _summary(asked: SweepSettings) -> str:
    """Describe the sweep in a few words, for a reader of the folder."""
    kick = "chosen kicks" if asked.options.kick is None else f"kick {asked.options.kick:g} rad"
    return f"{asked.config.servo.kind} servo, {len(asked.settings)} points, {kick}"


def _cell(value: object) -> object:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "; ".join(map(str, value))
    return value
