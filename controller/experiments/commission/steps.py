"""The steps of a commissioning: each runs one experiment and returns its result as plain data.

The pictures are drawn after the data are stored, so that a failing picture cannot lose them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.commission.found import picture_name
from haptic_wall.controller.experiments.commission.outcome import Step
from haptic_wall.controller.experiments.commission.plan import DELAY_STEPS
from haptic_wall.controller.experiments.commission.store import AGAIN, LOGS, SWEEP, CommissionStore
from haptic_wall.controller.experiments.commission.sweep_points import OPTIONS, short_sweep
from haptic_wall.controller.experiments.delay import delay_report, measure_delay
from haptic_wall.controller.experiments.identify.identification import identify
from haptic_wall.controller.experiments.identify.identified_config import identified_config
from haptic_wall.controller.experiments.identify.text import report as identify_report
from haptic_wall.controller.experiments.rendered.rendering import (
    measure_rendering,
    rendering_report,
)
from haptic_wall.controller.experiments.sweep.ceiling import CeilingSearch
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.experiments.sweep.plan import PlanePoint
from haptic_wall.controller.experiments.sweep.result import PointResult
from haptic_wall.controller.experiments.sweep.store import LOGS as SWEEP_LOGS
from haptic_wall.controller.experiments.sweep.store import SweepSettings, SweepStore
from haptic_wall.controller.experiments.sweep.sweep import experiment_config, sweep
from haptic_wall.controller.experiments.testbed import ExperimentInterruptedError, Testbed
from haptic_wall.controller.settings import yaml_text as config_yaml
from haptic_wall.controller.settings.config import Config

Tell = Callable[[str], None]
Plot = Callable[..., None]
"""Draws a step's data, with the configuration's name as the title, as PNG to a path"""

_HARMLESS = frozenset(
    {
        "return delay",
        "latency timer",
        "reply time",
        "sustainable rate",
        "encoder at rest",
        "schedule",
        "schedule immediate",
        "schedule pipelined",
        "wake-up lateness",
        "secondary id",
        "shutdown",
    }
)
"""Findings that do not prevent a commissioning: they only cost stiffness, or the start-up repairs
them. With any other one a run would be refused, or could not be trusted."""


_SLOW = 0.3
"""Frequency of a vibration that was seen, over the rate, at most"""


@dataclass(frozen=True, slots=True)
class StepContext:
    """Configuration, folder and settings that every step uses."""

    config: Config
    name: str
    """Name of the configuration, for people"""
    reach: float
    """Largest excursion during the identification [rad]"""
    store: CommissionStore
    tell: Tell
    plots: Mapping[Step, Plot] = field(default_factory=dict)
    """Draws each step's picture; a step without one has no picture"""
    points: tuple[PlanePoint, ...] | None = None
    """Points of the sweep; None: planned by the identified model"""
    before: Callable[[Step], None] = lambda _step: None
    """Called before each step that is executed"""
    partly: dict[str, Any] = field(default_factory=dict)
    """Data of a step that ends early, as far as it came"""

    @property
    def logs(self) -> Path:
        """Return the folder of the logs."""
        return self.store.folder / LOGS

    def picture(self, step: Step) -> Path:
        """Return the path of a step's picture."""
        return self.store.folder / picture_name(step)


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
            "not_examined": report.not_examined,
            "reached": report.reached,
            "suits": report.suits,
            "fatal": [f.name for f in report.wrong if f.name not in _HARMLESS],
        }
    )


def run_identify(bench: StepContext) -> StepResult:
    """Identify the servo; write the configuration with the result at once."""
    found = identify(bench.config, bench.logs, bench.reach, bench.tell)
    text = identified_config(bench.config, found, bench.name)
    bench.store.keep_config(text)
    return StepResult({**identify_report(found), "config_text": text}, (found,))


def identified(text: str, config: Config) -> Config:
    """Check the configuration that ``run_identify`` has stored, and return it.

    Args:
        text: The stored text.
        config: Its original: all but the model must be equal, or a foreign folder could raise a
            torque limit.

    Raises:
        UserError: It differs, or is invalid.
    """
    where = "identify.json: its configuration"
    try:
        found = Config.model_validate(config_yaml.parse(text, where))
    except ValidationError as error:
        raise UserError(
            f"{where} has {error.error_count()} wrong fields", advice=AGAIN.format("identify")
        ) from None
    except UserError as error:
        raise UserError(error, advice=AGAIN.format("identify")) from None
    if found.model_copy(update={"model": config.model}) != config:
        raise UserError(
            f"{where} differs from CONFIG in more than the model", advice=AGAIN.format("identify")
        )
    return found


def run_delay(bench: StepContext) -> StepResult:
    """Measure the loop's delay, and whether inserted delays are recovered."""
    config = bench.config
    found = measure_delay(config, bench.logs, DELAY_STEPS, tell=bench.tell)
    return StepResult(delay_report(found, config.period_s, config.belief().delay.high), (found,))


def run_rendered(bench: StepContext) -> StepResult:
    """Measure the stiffness, the drag and the contacts that the servo renders."""
    found = measure_rendering(bench.config, bench.logs, 0, bench.tell)
    return StepResult(rendering_report(found), (found,))


def run_sweep(bench: StepContext) -> StepResult:
    """Measure the critical stiffness at a few points; an interrupted sweep continues.

    Where a load vibrates, the ceiling of the virtual damping is measured first.

    Raises:
        ExperimentInterruptedError: A person has ended it; finished points are kept.
    """
    config = experiment_config(bench.config)
    settings = bench.points or short_sweep(config)
    asked = SweepSettings(config, settings, OPTIONS)
    folder = bench.store.folder / SWEEP
    try:
        store = SweepStore(folder, asked, fresh=False)
    except UserError:  # of an older model
        store = SweepStore(folder, asked, fresh=True)

    ceiling = None

    def data() -> dict[str, Any]:
        found = None if ceiling is None else ceiling.report()
        return store.report(bench.name) | {"ceiling": found}

    def progress(setting: PlanePoint, point: PointResult) -> None:
        bench.partly.update(data())
        said = point.reason if point.measured is None else f"{point.measured:.4g} N·m/rad"
        bench.tell(
            f"{len(store.done)}/{len(settings)}  B {setting.virtual_damping:g},"
            f" {setting.delay_steps} steps: {said}"
        )

    if store.done:
        bench.partly.update(data())
    if _vibrates(config):
        bed = Testbed(config, folder / SWEEP_LOGS, bench.tell)
        ceiling = CeilingSearch(bed, config.delay.steps, bench.tell).run()
    finished = sweep(config, store, settings, OPTIONS, tell=bench.tell, progress=progress)
    if not finished:
        raise ExperimentInterruptedError("interrupted", advice=f"{len(store.done)} points are kept")
    store.write()
    return StepResult(data(), (store.points(), Device.of(config)))


def _vibrates(config: Config) -> bool:
    """Return whether a vibration of a load was identified, whose ceiling can be measured."""
    belief = config.belief()
    return belief.is_flexible and belief.flexible_hz.high < _SLOW * config.loop.rate_hz


RUN: dict[Step, Callable[[StepContext], StepResult]] = {
    "doctor": run_doctor,
    "identify": run_identify,
    "delay": run_delay,
    "rendered": run_rendered,
    "sweep": run_sweep,
}
"""The function of each step"""
