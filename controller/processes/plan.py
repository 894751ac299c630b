"""What to run, and what is known when it is over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.processes.hold import Hold
from haptic_wall.controller.processes.stream import Stream
from haptic_wall.controller.runtime.safety import StopReason
from haptic_wall.controller.runtime.statistics import RunStatistics
from haptic_wall.controller.settings.config import Config

Tell = Callable[[str], None]
"""Called with what a person should know meanwhile."""


class LogState(StrEnum):
    """What there is of a run's log when the run is over."""

    NONE = "none"
    """There were no rows to write."""
    WHOLE = "whole"
    INCOMPLETE = "incomplete"
    """It lacks rows, or how the run ended."""
    MISSING = "missing"
    """It could not be written, or was removed or moved during the run."""


@dataclass(slots=True)
class Ended:
    """What is known when a run is over."""

    stop_reason: StopReason
    statistics: RunStatistics
    ticks: int
    missed: int
    result: dict[str, Any] | None = None
    """The loop's own ``session.Result``; None: it ended without one"""
    realtime: list[dict[str, Any]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    cause: str = ""
    """Of a run that was ended from outside of the loop: what happened, and to the torque"""
    cut: bool | None = None
    """Whether torque off was read back by the supervisor; None: the loop had seen to it"""
    asked: bool = False
    """A signal has asked to stop; where the loop was just over, the reason does not say so"""
    lacking: int | None = 0
    """Rows that the log lacks; None: nobody knows, since part of it is lost"""
    log: LogState = LogState.NONE

    @property
    def logged(self) -> bool:
        """Whether the log is where it should be, whole or not."""
        return self.log in (LogState.WHOLE, LogState.INCOMPLETE)

    @property
    def torque_off(self) -> bool | None:
        """Whether torque off was read back in the end; None: nobody knows."""
        if self.cut is None and self.result is not None:
            return bool(self.result["torque_off"])
        return self.cut


@dataclass(frozen=True, slots=True)
class Plan:
    """What to run, and where its traces go."""

    config: Config
    duration_s: float | None
    log: Path
    metadata: dict[str, Any]
    witness: Path | None
    """Record of the emulated bus; None: none"""
    program: tuple[Phase, ...] = ()
    """What is rendered in place of the wall; the run ends with it. Empty: the wall"""
    stream: Stream | None = None
    """Who watches live; None: nobody"""
    hold: Hold | None = None
    """The dead man; None: there is none"""
    force: bool = False
    """Log and record may replace files that are none of this program's"""
