"""Repeats the oscillation watch of a run on the run's log."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.detector.detection import Known, position_step
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.state import State
from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.errors import ConfigError, LogFormatError
from haptic_wall.controller.laws.wall import Law
from haptic_wall.controller.logs.detected import Detected, add
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.recording import LEAST, Part
from haptic_wall.controller.logs.replay import LaterWall, Replay
from haptic_wall.controller.logs.walls import Walls, walls_of
from haptic_wall.controller.runtime.telemetry import FLAG_WARM_UP
from haptic_wall.controller.runtime.watch_settings import watch_settings
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.printable import in_line
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.servo import Outcome

MOVED = "position or law of the wall changed: each stretch is judged with its own wall"
_GATHERED = 100_000
"""Rows processed at a time"""


@dataclass(frozen=True, slots=True)
class _Facts:
    """Facts of the servo that the log contains; see ``haptic_wall.hw.servo.Facts``."""

    torque_limit: float = math.inf
    stall_torque: float = math.inf
    position_step: float = 0.0


def replayed(path: Path, given: Mapping[str, float | None]) -> Detected | None:
    """Run a log's own watch on it again; None: the log lacks the necessary data.

    A change of the running wall changes law and watch in the row where it did in the run. None are
    the logs of experiments, which render no wall, logs that lack rows before their last one, and
    those of laws whose modules are closed.

    Args:
        path: A log of this program.
        given: ``inertia``, ``damping``, ``coulomb``, ``lag`` in place of the believed values; None:
            the believed ones.

    Raises:
        LogFormatError: It is not a log of this program, or its configuration cannot be used here.
        OSError: It cannot be read.
    """
    log = LogReader.open(path)
    blocks = _gathered(log.blocks())
    first = next(blocks, None)
    if first is None or first["seq"][0] != 0 or "phases" in log.metadata:
        return None
    position: FloatArray = first["position"]
    known = position[np.isfinite(position)]
    walls = walls_of(log.metadata, log.changes)
    if walls.closed() or not known.size or not _is_whole(log):
        return None
    replay, detected = _replay(walls, _facts(log, first), float(known[0]), given)
    if walls.moves():
        detected.notes.append(MOVED)
    return _seen(replay, detected, chain([first], blocks))


def _is_whole(log: LogReader) -> bool:
    """Whether no row is missing before the log's last one, and the wall was on long enough."""
    following = on = 0
    for rows in log.blocks():
        last = int(rows["seq"][-1])
        if last + 1 != following + len(rows):
            return False
        following = last + 1
        on += int(np.count_nonzero((rows["flags"] & FLAG_WARM_UP) == 0))
    return on >= LEAST


def _facts(log: LogReader, first: NDArray[np.void]) -> _Facts:
    told = (log.end or {}).get("servo")
    if not isinstance(told, dict):  # the run was killed
        good = first["outcome"] == Outcome.OK
        return _Facts(position_step=position_step(np.where(good, first["position"], np.nan)))
    counts = _above_0(told.get("counts_per_rev"), math.inf)
    return _Facts(
        torque_limit=_above_0(told.get("torque_limit"), math.inf),
        stall_torque=_above_0(told.get("stall_torque"), math.inf),
        position_step=math.tau / counts,
    )


def _above_0(value: object, default: float) -> float:
    """Return a number above 0 from a file, or the default."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if number and 0.0 < value < 1e12 else default  # type: ignore[operator, arg-type]


def _replay(
    walls: Walls, facts: _Facts, started_at: float, given: Mapping[str, float | None]
) -> tuple[Replay, Detected]:
    made = [_wall(config, facts, started_at, given) for config in walls.configs]
    law, settings, before_age_s = made[0]
    later = {
        seq: LaterWall(law, settings, before_age_s)
        for index, (seq, (law, settings, before_age_s)) in enumerate(
            zip(walls.since, made, strict=True)
        )
        if index
    }
    watch = Watch(settings)
    if before_age_s is None:
        watch.set_age(0.0)
    config = walls.configs[0]
    detected = Detected(
        period=settings.period,
        known={
            **_servo(config, given),
            "lag": settings.lag + config.delay.steps * settings.period,
        },
        wall={"stiffness": math.nan, "virtual_damping": math.nan, "wall_position": law.position},
        position_step=facts.position_step,
    )
    period_ns = walls.configs[0].period_ns
    return Replay(watch, law, period_ns, before_age_s, later), detected


def _wall(
    config: Config, facts: _Facts, started_at: float, given: Mapping[str, float | None]
) -> tuple[Law, WatchSettings, float | None]:
    """Return law and settings of the watch, and the delay without the age of a sample [s].

    The delay is None where the watch knows its lag.
    """
    try:
        law = config.law(facts.position_step)
    except ConfigError as error:
        problem = in_line(str(error.problem), 1000)
        raise LogFormatError(f"law and servo of the log do not agree: {problem}") from error
    law.position = config.surface(started_at)
    settings, inserted = watch_settings(config, facts, law), config.delay.steps * config.period_s
    if given["inertia"] is not None:
        settings = replace(settings, light=given["inertia"], heavy=given["inertia"])
    lag = given["lag"]
    if lag is not None:
        return law, replace(settings, lag=max(0.0, lag - inserted)), None
    return law, settings, inserted + config.belief().delay.high


def _servo(config: Config, given: Mapping[str, float | None]) -> dict[str, float]:
    """Return the believed servo in commanded torque, with the given values in their place."""
    belief = config.belief()
    gain = belief.torque_gain.value
    values = {
        "inertia": belief.inertia.value / gain,
        "damping": belief.damping.value / gain,
        "coulomb": belief.coulomb.value / gain,
    }
    told = {name: given[name] for name in values}
    return values | {name: value for name, value in told.items() if value is not None}


def _seen(replay: Replay, detected: Detected, blocks: Iterable[NDArray[np.void]]) -> Detected:
    origin_ns: int | None = None
    failed = 0
    ages: list[float] = []
    for rows in blocks:
        block = rows[(rows["flags"] & FLAG_WARM_UP) == 0]
        if not block.size:
            continue
        goes_on = origin_ns is not None
        if origin_ns is None:
            origin_ns = int(block["deadline_ns"][0])
            detected.wall["stiffness"] = float(block["stiffness"][0])
            detected.wall["virtual_damping"] = float(block["damping"][0])
        good = block["outcome"] == Outcome.OK
        failed += int(np.count_nonzero(~good))
        ages.append(float(np.median(block["age_ns"])) * 1e-9)
        part = Part(
            times=(block["deadline_ns"] - origin_ns) * 1e-9,
            positions=np.where(good, block["position"], np.nan),
            torques=block["torque"].astype(np.float64),
            stiffness=block["stiffness"].astype(np.float64),
        )
        known = Known(detected.period, position_step=detected.position_step)
        add(detected, part, replay.see(block, part, known), goes_on=goes_on)
    if failed:
        detected.notes.append(f"{failed} readings failed or were late and are left out")
    if replay.unknown:
        detected.notes.append(
            f"the log lacks {replay.unknown} changes of the wall: the wall before them is used"
        )
    watch = replay.watch
    detected.known["lag"] += float(np.median(ages)) if replay.counts_ages else 0.0
    _as_reported(detected, watch)
    return detected


def _as_reported(detected: Detected, watch: Watch) -> None:
    """Remove an alarm that a probe took back, as the run's report does."""
    seen = watch.state > State.QUIET
    if watch.state != detected.state or not seen:
        detected.growth = math.nan
    detected.state = watch.state
    detected.frequency_hz = watch.frequency_hz if seen else math.nan
    detected.amplitude = watch.amplitude if seen else 0.0
    detected.first_alarm_s = watch.first_alarm_s


def _gathered(blocks: Iterable[NDArray[np.void]]) -> Iterator[NDArray[np.void]]:
    """Yield the rows in large blocks."""
    held: list[NDArray[np.void]] = []
    for block in blocks:
        held.append(block)
        if sum(map(len, held)) >= _GATHERED:
            yield np.concatenate(held)
            held = []
    if held:
        yield np.concatenate(held)
