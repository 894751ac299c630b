"""A sweep: the critical stiffness at many points, one after the other or side by side.

On the simulated clock the points share the machine's cores; on hardware, and wherever time is
real, there is one servo and one run at a time.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, as_completed
from pathlib import Path

from haptic_wall.controller.experiments.processes import cores, not_from_the_terminal, processes
from haptic_wall.controller.experiments.sweep.critical import PointSearch
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.experiments.sweep.plan import (
    Hold,
    Options,
    Setting,
    hold_spring,
    reach,
    trial_phase,
)
from haptic_wall.controller.experiments.sweep.result import PointResult
from haptic_wall.controller.experiments.sweep.store import LOGS, SweepStore
from haptic_wall.controller.experiments.testbed import ExperimentInterruptedError, Testbed
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.signals import interrupting

_TRIALS = 8, 4
"""Trials of a point: in a typical sweep, and for each repeat more"""
_RUNS, _START_S = 3, 4.0
"""Runs of a point, and what each takes beside its trials [s]"""
_SETTLE_S = 1.2
"""Duration of the soft spring's phase, roughly [s]"""

Progress = Callable[[Setting, PointResult], None]


def experiment_config(config: Config) -> Config:
    """The configuration as a sweep runs it: no hand on a simulated shaft."""
    raw = config.model_dump(mode="json")
    if config.servo.kind != "hardware":
        raw["servo"]["hand"] = "none"
    return Config.model_validate(raw)


def sweep(
    config: Config,
    store: SweepStore,
    settings: tuple[Setting, ...],
    options: Options,
    *,
    tell: Callable[[str], None] = lambda _text: None,
    progress: Progress = lambda _setting, _result: None,
    workers: int | None = None,
) -> bool:
    """Measure the points that are not done yet; each is kept as soon as it is.

    Args:
        config: The servo.
        store: Where results go.
        settings: The points.
        options: Kick, repeats, tolerance.
        tell: Called with what is tried, where points are measured one after the other.
        progress: Called after each point.
        workers: Processes on the simulated clock; None: one for each core.

    Returns:
        False when a person has interrupted it.

    Raises:
        ServoError: The servo could not be started.
        ExperimentTrippedError: It was lost, or must be looked at before it may move again.
        UserError: The configuration does not do, or results or a log could not be kept.
    """
    left = [setting for setting in settings if setting not in store.done]
    folder = store.folder / LOGS
    count = min(workers or cores(), len(left))
    try:
        with interrupting():
            if config.loop.clock == "simulated" and count > 1:
                _side_by_side(config, store, left, options, folder, count, progress)
            else:
                bed = Testbed(config, folder, tell)
                for setting in left:
                    result = PointSearch(bed, setting, options, tell).run()
                    store.add(setting, result)
                    progress(setting, result)
    except (KeyboardInterrupt, ExperimentInterruptedError):
        return False
    return True


def _side_by_side(
    config: Config,
    store: SweepStore,
    left: list[Setting],
    options: Options,
    folder: Path,
    count: int,
    progress: Progress,
) -> None:
    text = config.model_dump_json()
    with processes(count) as pool:
        places: dict[Future[PointResult], Setting] = {}
        try:
            with not_from_the_terminal():
                for setting in left:
                    places[pool.submit(measure, text, folder, setting, options)] = setting
            for future in as_completed(places):
                result = future.result()
                store.add(places[future], result)
                progress(places[future], result)
        finally:
            for future in places:
                future.cancel()


def measure(config: str, folder: Path, setting: Setting, options: Options) -> PointResult:
    """One point in a process of its own; the configuration travels as JSON."""
    bed = Testbed(Config.model_validate_json(config), folder)
    return PointSearch(bed, setting, options).run()


def expected_s(config: Config, settings: tuple[Setting, ...], options: Options) -> float:
    """About how long the points take in real time [s]."""
    device = Device.of(config)
    total = 0.0
    for setting in settings:
        delay = setting.delay_steps * device.period + device.lag
        if device.exact(setting.virtual_damping, delay) <= 0.0:
            continue
        at = reach(device, setting, delay, options.kick)
        trial = trial_phase(device, setting, delay, at.predicted, at.kick).seconds + _SETTLE_S
        total += _RUNS * _START_S + (_TRIALS[0] + _TRIALS[1] * options.repeats) * trial
    return total


def excursion(config: Config, settings: tuple[Setting, ...], options: Options) -> float:
    """How far the shaft may come from where it stands, if all goes as planned [rad].

    A motion that has grown as far as a trial lets it is caught by the soft spring.
    """
    device = Device.of(config)
    furthest = 0.0
    for setting in settings:
        delay = setting.delay_steps * device.period + device.lag
        if device.exact(setting.virtual_damping, delay) <= 0.0:
            continue
        at = reach(device, setting, delay, options.kick)
        phase = trial_phase(device, setting, delay, at.predicted, at.kick)
        hold: Hold = hold_spring(device, setting.delay_steps, device.period, at.kick)
        ratio = (at.predicted / hold.stiffness) ** 0.5
        furthest = max(furthest, (phase.reach or 0.0) * (1.0 + ratio) ** 0.5 + at.kick)
    return furthest
