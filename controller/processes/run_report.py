"""Assembles the report of a run, under the names that outside tools read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from haptic_wall.controller.processes.plan import Ended, LogState
from haptic_wall.controller.runtime.safety import (
    AFTER_STALL,
    EXPLANATIONS,
    OF_THE_BUS,
    End,
    StopReason,
    Trip,
    emulator_late,
    stall_advice,
)
from haptic_wall.controller.runtime.statistics import RunStatistics
from haptic_wall.controller.settings.axes_rules import UNLIKE_ADVICE, unlike_model
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.servo import Servo
from haptic_wall.hw.errors import Problem


def run_report(config: Config, ended: Ended, log: str | None, plot: str | None) -> dict[str, Any]:
    """Return the report as JSON-ready values; None for unknown values."""
    result = ended.result or {}
    statistics = ended.statistics
    elapsed = result.get("elapsed_s") or ended.ticks / config.loop.rate_hz
    simulated, real_s = config.loop.clock == "simulated", result.get("real_s")
    counts = result.get("bus")
    # A loop that died has told nothing of them.
    parts: dict[str, dict[str, Any]] = result.get("axes") or {name: {} for name in config.axes}
    axes = {
        name: {key: part.get(key) for key in ("guard", "oscillation", "delay_s", "bus")}
        | {"wall_came_on": bool(part.get("wall_came_on")), "torque": statistics.torque(index)}
        for index, (name, part) in enumerate(parts.items())
    }
    return {
        "ticks": ended.ticks,
        "duration_s": elapsed,
        "missed_ticks": ended.missed,
        "rate_hz": ended.ticks / elapsed if elapsed else None,
        "grid_hz": result.get("grid_hz"),
        # Speed of the simulated clock relative to real time.
        "real_time_factor": elapsed / real_s if simulated and real_s else None,
        "stalled_s": result.get("stalled_s"),
        "lateness_us": statistics.lateness.as_report(50, 99, 99.9),
        "work_us": statistics.work.as_report(50, 99, 99.9),
        "bus_us": statistics.bus.as_report(50, 99, 99.9),
        "bus": counts and {**counts, "sample_age_us": statistics.age.as_report(50, 99)},
        "delay_s": result.get("delay"),
        "guard": result.get("guard"),
        "oscillation": result.get("oscillation"),
        "torque": statistics.torque(),
        **({"axes": axes} if axes else {}),
        "stop_reason": ended.stop_reason,
        "stop_axis": result.get("stop_axis"),
        "explanation": explanation(ended, config.servo),
        "wall_came_on": bool(result.get("wall_came_on")),
        "waited_for": result.get("waited_for") or None,
        "no_stiffness": no_stiffness(result, statistics),
        "torque_off": ended.torque_off,
        "servo_checks": result.get("checks", []),
        "realtime": ended.realtime,
        "warnings": [*warnings_of(ended), *_of_another_servo(config)],
        "changes": ended.changes,
        "log": log,
        "log_state": ended.log,
        "plot": plot,
    }


def _of_another_servo(config: Config) -> Iterator[str]:
    """Yield warnings of beliefs that cannot be those of their servos."""
    for name, one in config.each.items():
        if unlike := unlike_model(one):
            yield f"{f'{name}: ' if name else ''}{unlike}: {UNLIKE_ADVICE}"


def no_stiffness(result: dict[str, Any], statistics: RunStatistics) -> str | None:
    """Describe the walls that were to have stiffness and had none for most of their time.

    Args:
        result: The loop's result.
        statistics: Of the run's rows.

    Returns:
        None: there are none.
    """
    texts = []
    for index, (name, part) in enumerate((result.get("axes") or {"": result}).items()):
        acted, limp = statistics.acted[index], statistics.limp[index]
        guard = part.get("guard")
        if guard is None or not guard["requested"]["stiffness"] or 2 * limp <= acted:
            continue
        of = f"{name}: " if name else ""
        time = "" if limp == acted else f" for {100 * limp / acted:.3g} % of the time"
        limit = f", limited by {guard['binding']}" if guard["binding"] else ""
        asked = guard["requested"]["stiffness"]
        texts.append(f"{of}the guard commanded 0 of {asked:.4g} N·m/rad{time}{limit}")
    return "; ".join(texts) or None


def explanation(ended: Ended, servo: Servo) -> str | None:
    """Explain a trip in a sentence; see ``explained``."""
    problem = explained(ended, servo)
    return None if problem is None else str(problem)


def explained(ended: Ended, servo: Servo) -> Problem | None:
    """Explain a trip and its remedy; None where the run ended as planned.

    Args:
        ended: The outcome of the run.
        servo: Of its configuration: a pseudo-terminal has no cable.
    """
    trip = Trip.of(ended.stop_reason)
    if trip is None:
        return None
    means, result = EXPLANATIONS[trip], ended.result or {}
    axis, stalled = result.get("stop_axis"), result.get("stalled")
    message = result.get("message", "")
    # A stall, or a late emulator, would not lose one of several.
    known = bool(axis) and trip in OF_THE_BUS
    if trip is Trip.SERVO_LOST and message:  # it names the cause, with its remedy
        emulator = "the emulator at this port may have ended" if servo.is_emulated else ""
        means, message, known = Problem(message.rstrip("."), advice=emulator), "", True
    elif trip in OF_THE_BUS and servo.is_emulated:
        late = not known and not stalled
        means = emulator_late(granted=ended.granted) if late else Problem(means.what)
    if stalled and trip in AFTER_STALL and not ended.cause:
        rest, otherwise = stall_advice(granted=ended.granted), means.advice
        what, advice = f"{means.what}, and {stalled} too", [otherwise, f"against the stall, {rest}"]
        if not known:
            what = f"{stalled}: {means.what}"
            advice = [rest, f"without a stall {otherwise}" if otherwise else ""]
        means = replace(means, what=what, advice="; ".join(filter(None, advice)))
    if axis:
        means = replace(means, what=f"{axis}: {means.what}")
    if ended.cause:
        return replace(means, what="; ".join(filter(None, (ended.cause, means.what))))
    return means.followed_by(f" ({message})") if message else means


def exit_status(
    stop_reason: StopReason, no_wall: str | None = None, log: LogState = LogState.NONE
) -> int:
    """Return the exit status for a stop reason.

    The fate of the shaft takes precedence over the fate of the log: only a run that ended as
    planned reports its log.

    Args:
        stop_reason: Why the run ended.
        no_wall: Why a wall never came on, or has no stiffness; None: it has, or the run ended
            before.
        log: State of its log.
    """
    if stop_reason == Trip.SERVO_LOST:
        return 4
    if no_wall:
        return 3
    if stop_reason == End.INTERRUPTED:
        return 130
    if stop_reason != End.DURATION:
        return 3
    return 5 if log in (LogState.INCOMPLETE, LogState.MISSING) else 0


def warnings_of(ended: Ended) -> list[str]:
    """Return the notes of a report."""
    warnings = [*ended.warnings, *(ended.result or {}).get("warnings", [])]
    for setting in ended.realtime:
        if not setting["ok"]:
            warnings.append(
                f"{setting['name']}: wanted {setting['wanted']}, {setting['found']}"
                + (f"; to grant it: {setting['fix']}" if setting["fix"] else "")
            )
    if ended.missed and not ended.granted:
        periods = "1 period" if ended.missed == 1 else f"{ended.missed} periods"
        warnings.append(
            f"the loop missed {periods}: it had no real-time priority, so that other programs could"
            " keep the core"
        )
    if ended.statistics.unread:
        warnings.append(f"{ended.statistics.unread} rows were not read in time for the statistics")
    return warnings
