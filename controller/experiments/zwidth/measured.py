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
from haptic_wall.controller.experiments.processes import cores, processes
from haptic_wall.controller.experiments.sweep.store import SweepSettings, SweepStore
from haptic_wall.controller.experiments.sweep.sweep import expected_s, sweep
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
from haptic_wall.controller.system.files import make_folder, would_be_lost

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
    stores = [
        (width, SweepStore(folder / width.velocity.folder, asked, fresh))
        for width in widths
        if width.config is not None
        and (asked := SweepSettings(width.config, width.settings(), OPTIONS))
    ]
    left = any(not store.complete for _, store in stores)
    parallel = all(w.config is not None and w.config.loop.clock == "simulated" for w, _ in stores)
    with processes(cores()) if left and parallel else nullcontext() as pool:
        for width, store in stores:
            assert width.config is not None
            label, settings = width.velocity.label, width.settings()
            finished = sweep(
                width.config,
                store,
                settings,
                OPTIONS,
                tell=tell,
                progress=lambda _at, point, label=label: tell(  # type: ignore[misc]
                    f"{label}, B {point.virtual_damping:g}: "
                    + (f"{point.measured:.4g} N·m/rad" if point.measured else f"{point.reason}")
                ),
                pool=None if pool is None else nullcontext(pool),
            )
            width.points = store.points()
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
    raw = config.model_dump(mode="json")
    raw["wall"]["side"] = "both"
    raw["servo"]["hand"] = "tap"
    raw["safety"]["engage"] = "at-once"  # the hand keeps the shaft away from the middle
    tapped = Config.model_validate(raw)
    metadata = {
        "program": f"haptic-wall {__version__}",
        "name": "zwidth",
        "config": tapped.model_dump(mode="json"),
    }
    make_folder(log.parent)
    if would_be_lost(log):
        refuse_other(log)
    tell(f"impedance: the wall runs for {_TAPPED_S:g} s under a tapping hand")
    ended = run(Plan(tapped, _TAPPED_S, log, metadata, None, force=True), tell)
    if ended.stop_reason == End.INTERRUPTED or ended.asked:
        raise ExperimentInterruptedError("interrupted")
    if ended.stop_reason != End.DURATION:
        raise ExperimentTrippedError(ended.stop_reason, explained(ended, config.servo) or "")
    return log
