"""The outcome of a session: why it ended, what it did, and what the axes report."""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from haptic_wall.controller.detector.watch import oscillation_report
from haptic_wall.controller.runtime.assembly import decision_in_force, situation_of
from haptic_wall.controller.runtime.safety import StopReason, Trip
from haptic_wall.controller.runtime.session_report import (
    all_axes,
    delay_report,
    guard_report,
    missed_warnings,
    stall_warnings,
)
from haptic_wall.controller.runtime.session_start import Session
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.servo import Check, Facts, Traffic


@dataclass(frozen=True, slots=True)
class Result:
    """The outcome of a session; all of it can be sent as JSON."""

    stop_reason: StopReason
    message: str
    """A remark of the program itself; usually empty"""
    ticks: int
    missed: int
    elapsed_s: float
    real_s: float
    """Duration of the run in real time, without the start-up [s]"""
    grid_hz: float
    guard: dict[str, Any] | None
    """None, as the next one: there are several axes, or a defect occurred before it was reported"""
    oscillation: dict[str, Any] | None
    """Of the worst axis"""
    delay: dict[str, float] | None
    """The longest one"""
    bus: dict[str, Any] | None
    torque_off: bool
    stop_axis: str | None = None
    """The axis that ended the run; None: none did, or there is only one"""
    axes: dict[str, dict[str, Any]] = field(default_factory=dict)
    """The parts of several axes: guard, oscillation, delay_s, bus, wall_came_on, servo"""
    checks: list[Check] = field(default_factory=list)
    facts: dict[str, float | None] | None = None
    """The servo's values that the oscillation watch uses; None: there are several"""
    wall_came_on: bool = False
    """All have"""
    waited_for: str = ""
    """The unmet condition of a wall that never came on; empty: it came on, or the run ended before
    """
    warnings: list[str] = field(default_factory=list)
    """Warnings of the loop itself"""
    stalled: str = ""
    """A stall of this computer just before the end, which may explain it; empty: none"""
    stalled_s: float | None = None
    """How long loop and emulated bus waited for this computer [s]; None: they do not wait"""


@dataclass(frozen=True, slots=True)
class Ended:
    """How the loop of a session ended."""

    reason: StopReason
    message: str
    """The cause, as far as the loop knows it; empty: the servos' own trouble says it"""
    number: int
    """Of the axis that ended it, from 1; 0: none did, or there is only one"""
    real_s: float
    """Duration in real time [s]"""
    stall_s: float
    """A stall of this computer just before [s]; 0: none"""
    stalled_s: float | None
    """As of ``Result``"""
    torque_off: bool
    """It was read back"""
    waited_for: str
    """As of ``Result``"""


def outcome(session: Session, ended: Ended, on_block: Callable[[], None]) -> Result:
    """Return the outcome of a session, whose bus is closed.

    Args:
        session: The session.
        ended: Its end.
        on_block: Called before the guard's reasons are computed.
    """
    reason, defect, loop = ended.reason, "", session.loop
    indices = range(len(session.axes))
    parts = [_known(session, index) for index in indices]
    try:
        on_block()
        parts = [parts[index] | _computed(session, index, parts[index]) for index in indices]
    except Exception as error:  # noqa: BLE001 - it must not cost what is known of the run
        defect = f"after the run: {defect_text(error)}"
        reason = reason if isinstance(reason, Trip) else Trip.INTERNAL_ERROR
    told, names = all_axes(parts), list(session.configs)
    if (bus := told["bus"]) is not None:
        bus = bus | {"schedule": "pipelined" if session.pipelined else "immediate"}
    worst_missed = max(axis.safety.worst_missed for axis in session.axes)
    stalled = f"this computer stalled for {ended.stall_s * 1e3:.0f} ms" if ended.stall_s else ""
    return Result(
        stop_reason=reason,
        stop_axis=names[ended.number - 1] if ended.number else None,
        message="; ".join(filter(None, (_told(session, ended), defect))),
        ticks=loop.cycle.ticks,
        missed=loop.missed,
        elapsed_s=loop.elapsed_s,
        real_s=ended.real_s,
        grid_hz=1e9 / loop.period_ns,
        guard=told.get("guard"),
        oscillation=told.get("oscillation"),
        delay=told.get("delay_s"),
        bus=bus,
        torque_off=ended.torque_off,
        axes={} if "" in names else dict(zip(names, parts, strict=True)),
        checks=session.checks,
        facts=told.get("servo"),
        wall_came_on=told["wall_came_on"],
        waited_for=ended.waited_for,
        warnings=[*missed_warnings(session.config, worst_missed), *stall_warnings(ended.stalled_s)],
        stalled=stalled,
        stalled_s=ended.stalled_s,
    )


def _told(session: Session, ended: Ended) -> str:
    """Return why the run ended, as loop, safety and bus say it."""
    trouble, number = session.bus.trouble, ended.number
    axes = [session.axes[number - 1]] if number else session.axes
    found = next(filter(None, (axis.safety.found for axis in axes)), "")
    message = ended.message or found or trouble
    if trouble and trouble != message and len(session.axes) > 1:  # of another one perhaps
        message += f"; {trouble}"
    return message


def _known(session: Session, index: int) -> dict[str, Any]:
    """Return the report's part on an axis, without what has to be computed."""
    axis, servo = session.axes[index], session.servos[index]
    return {
        "bus": _counts(servo.traffic, index, axis.safety.refused),
        "wall_came_on": axis.came_on,
        "servo": _facts(servo.facts),
    }


def _computed(session: Session, index: int, known: dict[str, Any]) -> dict[str, Any]:
    """Return the rest of the report's part on an axis."""
    axis, servo, decided = session.axes[index], session.servos[index], session.decided[index]
    config = list(session.configs.values())[index]
    if axis.made is not None:
        config = Config.model_validate_json(axis.made.config)
    situation, bin_in_force = situation_of(config, servo), axis.gains.schedule.index
    decision = decision_in_force(config, servo, decided, bin_in_force, session.work)
    return {
        "guard": guard_report(config, decision, axis, session.loop.missed, situation, known["bus"]),
        "oscillation": oscillation_report(axis.watch),
        "delay_s": delay_report(situation, decision),
    }


def _counts(traffic: Traffic | None, index: int, refused: int) -> dict[str, int] | None:
    """Return the counts of a servo's replies."""
    return None if traffic is None else asdict(traffic.counts[index]) | {"refused": refused}


def _facts(facts: Facts) -> dict[str, float | None]:
    return {
        "counts_per_rev": facts.counts_per_rev,
        "torque_step": facts.torque_step,
        "torque_limit": facts.torque_limit if math.isfinite(facts.torque_limit) else None,
        "stall_torque": facts.stall_torque if math.isfinite(facts.stall_torque) else None,
    }


def defect_text(error: Exception) -> str:
    """Name an unexpected error, and the function, file and line in which it was raised.

    It reads no source file: the torque may still be on.
    """
    *_, (frame, line) = traceback.walk_tb(error.__traceback__)
    code = frame.f_code
    file = Path(code.co_filename).name
    return f"{type(error).__name__}: {error} (in {code.co_name}, {file} line {line})"
