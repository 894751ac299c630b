"""The steps of a commissioning: each runs one experiment and returns its result as plain data.

The pictures are drawn after the data are stored, so that a failing picture cannot lose them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple

from haptic_wall.controller.experiments.commission.plan import OPTIONS, short_sweep
from haptic_wall.controller.experiments.delay import high_age
from haptic_wall.controller.experiments.holding import without_hand
from haptic_wall.controller.experiments.identify.identification import identify
from haptic_wall.controller.experiments.identify.identified_config import identified_config
from haptic_wall.controller.experiments.identify.text import report as identify_report
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.experiments.sweep.plan import PlanePoint
from haptic_wall.controller.experiments.sweep.result import PointResult, point_text
from haptic_wall.controller.experiments.sweep.sweep import Sweep, sweep
from haptic_wall.controller.experiments.testbed import ExperimentInterruptedError
from haptic_wall.controller.settings.config import Config

LOGS, SWEEP, CONFIG = "logs", "sweep", "config.yaml"
"""In the folder of a commissioning: logs, the sweep's folder, the configuration with the model"""
Tell = Callable[[str], None]
Plot = Callable[..., None]
"""Draws a step's data, with the configuration's name as the title, as PNG to a path"""

_HARMLESS = {"return delay", "latency timer", "reply time", "sustainable rate", "wake-up lateness"}
_HARMLESS |= {"secondary id", "shutdown"}
"""Findings that do not prevent a commissioning: they only cost stiffness, or the start-up repairs
them. With any other one a run would be refused, or could not be trusted."""


Step = Literal["doctor", "identify", "sweep"]
STEPS: tuple[Step, ...] = ("doctor", "identify", "sweep")
TITLES: Mapping[Step, str] = {
    "doctor": "the testbed examined",
    "identify": "inertia, friction and delay identified",
    "sweep": "the critical stiffness measured",
}

State = Literal["done", "failed", "skipped", "interrupted"]


@dataclass(frozen=True, slots=True)
class StepOutcome:
    """The outcome of one step."""

    step: Step
    state: State
    reason: str | None = None
    """Why it has not been done; None: it is done"""
    exit_status: int = 0
    """Exit status of the command, if this is the first failed step"""
    ends_all: bool = False
    """No further step is possible with this servo now"""
    seconds: float = 0.0
    data: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class StepContext:
    """Configuration, folder and settings that every step uses."""

    config: Config
    name: str
    """Name of the configuration, for people"""
    reach: float
    """Largest excursion during the identification [rad]"""
    folder: Path
    tell: Tell
    plots: Mapping[Step, Plot] = field(default_factory=dict)
    """Draws each step's picture; a step without one has no picture"""
    points: tuple[PlanePoint, ...] | None = None
    """Points of the sweep; None: planned by the identified model"""
    partly: dict[str, Any] = field(default_factory=dict)
    """Data of a step that ends early, as far as it came"""

    def picture(self, step: Step) -> Path:
        """Return the path of a step's picture."""
        return self.folder / f"{step}.png"


class StepResult(NamedTuple):
    """The result of a step, and the data of its picture."""

    data: dict[str, Any]
    shown: tuple[Any, ...] = ()
    """Data for its plot; empty: no picture"""


def run_doctor(bench: StepContext) -> StepResult:
    """Examine the testbed; ``fatal`` names the findings to repair before any motion.

    Raises:
        ServoError: The emulated bus did not start.
    """
    from haptic_wall.controller.doctor.checkup import (
        examine,  # loaded only where there is a bus
    )

    report = examine(bench.config, bench.tell, None, change_baud=False)
    return StepResult(
        {
            "checks": [asdict(check) for check in report.found.values()],
            "reached": report.reached,
            "fatal": [f.name for f in report.wrong if f.name not in _HARMLESS],
        }
    )


def run_identify(bench: StepContext) -> StepResult:
    """Identify the servo; return the configuration with the result, and the age of samples too."""
    found = identify(bench.config, bench.folder / LOGS, bench.reach, bench.tell)
    text = identified_config(bench.config, found, bench.name)
    more = {"sample_age_s": high_age(found.played), "config_text": text}
    return StepResult({**identify_report(found), **more}, (found,))


def run_sweep(bench: StepContext) -> StepResult:
    """Measure the critical stiffness at a few points.

    Raises:
        ExperimentInterruptedError: A person has ended it; finished points are kept.
    """
    config = without_hand(bench.config)
    asked = Sweep(config, bench.points or short_sweep(config), OPTIONS, bench.folder / SWEEP)
    kept = asked.kept(fresh=True)

    def progress(point: PointResult) -> None:
        bench.partly.update(asked.report(kept))
        bench.tell(f"{len(kept.done)}/{len(asked.settings)}  {point_text(point)}")

    if not sweep(asked, kept, tell=bench.tell, progress=progress):
        raise ExperimentInterruptedError(
            "interrupted", advice=f"{len(kept.done)} of {len(asked.settings)} points are kept"
        )
    return StepResult(asked.report(kept), (asked.points(kept), Device.of(config)))


RUN: dict[Step, Callable[[StepContext], StepResult]] = {
    "doctor": run_doctor,
    "identify": run_identify,
    "sweep": run_sweep,
}
"""The function of each step"""
