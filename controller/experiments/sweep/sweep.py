"""Sweeps the critical stiffness over many points, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from haptic_wall.controller.experiments.kept import Kept
from haptic_wall.controller.experiments.sweep.critical import PointSearch
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.experiments.sweep.plan import (
    Options,
    PlanePoint,
    Reach,
    reach,
    soft_spring,
    trial_phase,
)
from haptic_wall.controller.experiments.sweep.result import PointResult
from haptic_wall.controller.experiments.testbed import (
    ExperimentInterruptedError,
    Testbed,
)
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.signals import interrupting

_TRIALS = 16
"""Number of trials of a point in a typical sweep"""
_RUNS, _START_S = 3, 4.0
"""Number of runs of a point, and duration of each without its trials [s]"""
_SETTLE_S = 1.2
"""Approximate duration of the soft spring's phase [s]"""

LOGS, ROWS = "logs", "sweep.rows"
"""In a sweep's folder: the folder of its logs, the file of finished points"""

Progress = Callable[[PointResult], None]


@dataclass(frozen=True, slots=True)
class Sweep:
    """All on which a sweep's results depend, and its folder."""

    config: Config
    settings: tuple[PlanePoint, ...]
    options: Options
    folder: Path
    """For logs and finished points; made by the first of them"""

    def kept(self, fresh: bool = False) -> Kept[PlanePoint, PointResult]:
        """Return the finished points.

        Args:
            fresh: Measure all of them again.

        Raises:
            UserError: See ``Kept``.
        """

        def read(line: dict[str, Any]) -> tuple[PlanePoint, PointResult]:
            point = PointResult(**line)
            return PlanePoint(point.virtual_damping, point.delay_steps), point

        described = {
            "config": self.config.model_dump(mode="json"),
            "settings": [asdict(setting) for setting in self.settings],
            "options": asdict(self.options),
        }
        return Kept(
            self.folder / ROWS, described, read, lambda _key, point: asdict(point), fresh=fresh
        )

    def report(self, kept: Kept[PlanePoint, PointResult]) -> dict[str, Any]:
        """Return JSON-ready values."""
        return {
            "servo": self.config.servo.kind,
            "clock": self.config.loop.clock,
            "period_s": self.config.period_s,
            "complete": len(kept.done) == len(self.settings),
            "points": [asdict(point) for point in self.points(kept)],
        }

    def points(self, kept: Kept[PlanePoint, PointResult]) -> list[PointResult]:
        """Return the finished points in the requested order."""
        return [kept.done[setting] for setting in self.settings if setting in kept.done]


def sweep(
    asked: Sweep,
    kept: Kept[PlanePoint, PointResult],
    *,
    tell: Callable[[str], None] = lambda _text: None,
    progress: Progress = lambda _result: None,
) -> bool:
    """Measure the unfinished points; keep each at once.

    Args:
        asked: The servo, the points, the folder.
        kept: The finished points.
        tell: Called with each trial.
        progress: Called after each point.

    Returns:
        False when a person has interrupted it.

    Raises:
        ServoError: The servo could not be started.
        ExperimentTrippedError: The servo or the bus must be examined before it may move again.
        UserError: The configuration is unsuitable, or results or a log could not be written.
    """
    left = [setting for setting in asked.settings if setting not in kept.done]
    bed = Testbed(asked.config, asked.folder / LOGS, tell)
    try:
        with interrupting():
            for setting in left:
                found = PointSearch(bed, setting, asked.options, tell).run()
                progress(kept.add(setting, found))
    except (KeyboardInterrupt, ExperimentInterruptedError):
        return False
    return True


def expected_s(config: Config, settings: tuple[PlanePoint, ...], options: Options) -> float:
    """Return the approximate duration of the points in real time [s]."""
    device = Device.of(config)
    return sum(
        _RUNS * _START_S + _TRIALS * (phase.seconds + _SETTLE_S)
        for _, _, phase in _predicted(device, settings, options)
    )


def excursion(config: Config, settings: tuple[PlanePoint, ...], options: Options) -> float:
    """Return the largest expected excursion of the shaft from its start [rad].

    The soft spring catches a motion that has grown to a trial's end.
    """
    device = Device.of(config)
    furthest = 0.0
    for setting, at, phase in _predicted(device, settings, options):
        hold = soft_spring(config, device, setting.delay_steps)
        ratio = (at.predicted / hold.stiffness) ** 0.5
        furthest = max(furthest, (phase.reach or 0.0) * (1.0 + ratio) ** 0.5 + at.kick)
    return furthest


def _predicted(
    device: Device, settings: tuple[PlanePoint, ...], options: Options
) -> Iterator[tuple[PlanePoint, Reach, Phase]]:
    """Yield the points where some stiffness is stable, with their reach and a trial's phase."""
    for setting in settings:
        delay = setting.delay_steps * device.period + device.lag
        if device.exact(setting.virtual_damping, delay) > 0.0:
            at = reach(device, setting, delay, options.kick)
            yield setting, at, trial_phase(device, setting, delay, at.predicted, at.kick)
