"""Describes a planned run and its outcome, as plain data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.live.place import Live
from haptic_wall.controller.runtime.safety import StopReason
from haptic_wall.controller.runtime.statistics import RunStatistics
from haptic_wall.controller.settings.config import Config

Tell = Callable[[str], None]
"""Called with messages for a person."""


class LogState(StrEnum):
    """State of a run's log when the run is over."""

    NONE = "none"
    """There were no rows to write."""
    WHOLE = "whole"
    INCOMPLETE = "incomplete"
    """It lacks rows, or the run's end."""
    MISSING = "missing"
    """It could not be written, or was removed or moved during the run."""


@dataclass(slots=True)
class Ended:
    """The outcome of a run."""

    stop_reason: StopReason
    statistics: RunStatistics
    ticks: int
    missed: int
    result: dict[str, Any] | None = None
    """The loop's own ``session.Result``; None: it ended without one"""
    realtime: list[dict[str, Any]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    cause: str = ""
    """Why the supervisor ended the run, and whether the torque is off"""
    cut: bool | None = None
    """Whether the supervisor read torque off back; None: the loop had done so"""
    asked: bool = False
    """Whether a signal asked the run to stop; the stop reason does not say so if the loop had just
    ended"""
    lacking: int | None = 0
    """Rows missing from the log; None: unknown, part of it is lost"""
    log: LogState = LogState.NONE
    changes: list[dict[str, Any]] = field(default_factory=list)
    """The last requested changes of the running wall"""
    unlogged: list[dict[str, Any]] = field(default_factory=list)
    """Those that the recorder could not take"""

    @property
    def logged(self) -> bool:
        """Whether the log file is there, complete or not."""
        return self.log in (LogState.WHOLE, LogState.INCOMPLETE)

    @property
    def granted(self) -> bool:
        """Whether the loop had real-time priority."""
        return any(each["name"] == "scheduler" and each["ok"] for each in self.realtime)

    @property
    def torque_off(self) -> bool | None:
        """Whether torque off was read back at the end; None: unknown."""
        if self.cut is None and self.result is not None:
            return bool(self.result["torque_off"])
        return self.cut


@dataclass(frozen=True, slots=True)
class Plan:
    """The description of a run and of the files it writes."""

    config: Config
    duration_s: float | None
    log: Path
    metadata: dict[str, Any]
    witness: Path | None
    """Record of the emulated bus; None: none"""
    program: tuple[Phase, ...] = ()
    """Phases that are rendered in place of the wall; the run ends with them. Empty: the wall"""
    live: Live | None = None
    """The page in a browser; None: none"""
    hold: str | None = None
    """The dead man: path of an input device, or ``hold.PAGE``; None: none"""
    changeable: bool = False
    """Whether the wall takes changes while it runs"""
    force: bool = False
    """Whether log and record may replace existing files"""

    @property
    def axes(self) -> tuple[str, ...]:
        """Return the names of the axes; one empty name: there is one servo."""
        return tuple(self.config.each)

    @property
    def elastic(self) -> bool:
        """Whether loop and emulated bus wait for each other."""
        config = self.config
        real = config.loop.clock == "monotonic" and config.realtime.profile != "strict"
        return config.servo.kind == "emulated" and real
