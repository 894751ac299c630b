"""Measures the Z-width: points of the stability boundary, and the impedance of one run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from haptic_wall import __version__
from haptic_wall.controller.experiments.commission.sweep_points import OPTIONS
from haptic_wall.controller.experiments.commission.verdict import GuardQuestion
from haptic_wall.controller.experiments.holding import changed
from haptic_wall.controller.experiments.processes import cores, processes
from haptic_wall.controller.experiments.sweep.plan import PlanePoint
from haptic_wall.controller.experiments.sweep.result import PointResult
from haptic_wall.controller.experiments.sweep.sweep import Sweep, expected_s, sweep
from haptic_wall.controller.experiments.testbed import (
    ExperimentInterruptedError,
    ExperimentTrippedError,
)
from haptic_wall.controller.experiments.zwidth.impedance import Impedance, commanded, from_log
from haptic_wall.controller.experiments.zwidth.plane import Width
from haptic_wall.controller.logs.file import refuse_other
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.processes.plan import Plan
from haptic_wall.controller.processes.run import run
from haptic_wall.controller.processes.run_report import explained
from haptic_wall.controller.runtime.safety import End
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.files import would_be_lost

LOG = "impedance.hwlog"
_TAPPED_S = 10.0
"""Duration of the run that is tapped [s]"""

Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Found:
    """The Z-width of a servo."""

    config: Config
    widths: tuple[Width, ...]
    impedance: Impedance

    def report(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return {
            "servo": self.config.servo.kind,
            "clock": self.config.loop.clock,
            "period_s": self.config.period_s,
            "side": self.config.wall.side,
            "margin": self.config.guard.margin,
            "widths": [width.report() for width in self.widths],
            "impedance": self.impedance.report(),
        }


def seconds_of(widths: Sequence[Width]) -> float:
    """Return about how long the points of these widths take in real time [s]."""
    configs = [(width, width.config) for width in widths]
    return sum(
        expected_s(config, width.settings(), OPTIONS)
        for width, config in configs
        if config is not None
    )


def measure_points(widths: Sequence[Width], folder: Path, fresh: bool, tell: Tell) -> None:
    """Measure the boundary at some dampings of each width, as ``sweep`` does.

    Args:
        widths: Those to measure; each gets its points.
        folder: Each width keeps its points in a folder there; those of the same settings are kept.
        fresh: Measure all of them anew.
        tell: Called with messages.

    Raises:
        ExperimentInterruptedError: A person has ended it; finished points are kept.
        ExperimentTrippedError: The servo must be examined before it may move again.
        ServoError: The servo could not be started.
        UserError: A folder holds points of other settings.
    """
    asked = [
        (width, Sweep(width.config, width.settings(), OPTIONS, folder / width.velocity.folder))
        for width in widths
        if width.config is not None
    ]
    sweeps = [(width, each, each.kept(fresh)) for width, each in asked]
    left = any(len(kept.done) < len(each.settings) for _, each, kept in sweeps)
    parallel = all(each.config.loop.clock == "simulated" for _, each, _ in sweeps)
    with processes(cores()) if left and parallel else nullcontext() as pool:
        for width, each, kept in sweeps:

            def progress(_at: PlanePoint, point: PointResult, width: Width = width) -> None:
                value = f"{point.measured:.4g} N·m/rad" if point.measured else f"{point.reason}"
                tell(f"{width.velocity.label}, B {point.virtual_damping:g}: {value}")

            own = None if pool is None else nullcontext(pool)
            finished = sweep(each, kept, tell=tell, progress=progress, pool=own)
            width.points = each.points(kept)
            if not finished:
                raise ExperimentInterruptedError(
                    "interrupted", advice=f"the same command with --out {folder.parent} continues"
                )


def impedance_of(config: Config, log: Path | None, folder: Path | None, tell: Tell) -> Impedance:
    """Return the impedance of the configured wall, measured where there is a log.

    Args:
        config: The wall.
        log: The log of a run; None: a simulated or emulated servo is tapped.
        folder: Folder for the log of that; None: nothing may run.
        tell: Called with messages.

    Raises:
        ServoError: The servo could not be started.
        ExperimentInterruptedError: A person has ended it.
        UserError: The log is not that of a wall.
    """
    reason = "nothing was run"
    if log is None and config.servo.kind == "hardware":
        reason = (
            "no log is given: run the wall, move the shaft by hand, and give the log with --log"
        )
    elif log is None and folder is not None:
        try:
            log = _tapped(config, folder / LOG, tell)
        except ExperimentTrippedError as error:
            reason = f"the run was ended by {error.stop_reason}: {error}"
    if log is not None:
        return from_log(LogReader.open(log))
    question = GuardQuestion.of(config, None)
    decision = question.decide(config.wall.stiffness, config.wall.damping)
    delay = question.inserted + question.age + question.situation.belief.delay.value
    found = commanded(config, decision.stiffness, decision.damping, delay)
    return found.because(reason)


def _tapped(config: Config, log: Path, tell: Tell) -> Path:
    """Run the two-sided wall under a tapping hand; return its log."""
    # The hand keeps the shaft away from the middle: the wall must not wait for it.
    safety = {"engage": "at-once"}
    tapped = changed(config, wall={"side": "both"}, servo={"hand": "tap"}, safety=safety)
    metadata = {
        "program": f"haptic-wall {__version__}",
        "name": "zwidth",
        "config": tapped.model_dump(mode="json"),
    }
    log.parent.mkdir(parents=True, exist_ok=True)
    if would_be_lost(log):
        refuse_other(log)
    tell(f"impedance: the wall runs for {_TAPPED_S:g} s under a tapping hand")
    ended = run(Plan(tapped, _TAPPED_S, log, metadata, None, force=True), tell)
    if ended.stop_reason == End.INTERRUPTED or ended.asked:
        raise ExperimentInterruptedError("interrupted")
    if ended.stop_reason != End.DURATION:
        raise ExperimentTrippedError(ended.stop_reason, explained(ended, config.servo) or "")
    return log
