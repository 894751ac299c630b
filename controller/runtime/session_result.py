"""The outcome of a session: why it ended, what it did, and what the axes report."""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from haptic_wall.controller.detector.state import State
from haptic_wall.controller.detector.watch import oscillation_report
from haptic_wall.controller.guard.decision_report import assumed, decision_report
from haptic_wall.controller.guard.types import Decision, Situation
from haptic_wall.controller.milliseconds import ms
from haptic_wall.controller.runtime.assembly import bins_of
from haptic_wall.controller.runtime.axis import Axis
from haptic_wall.controller.runtime.safety import StopReason, Trip
from haptic_wall.controller.runtime.session_start import Session
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.servo import Check

NOTED_S = 0.005
"""Sum of the stalls from which they are noted [s]"""


@dataclass(slots=True)
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
    torque_off: bool
    stop_axis: str | None
    """The axis that ended the run; None: none did, or there is only one"""
    checks: list[Check]
    waited_for: str
    """The unmet condition of a wall that never came on; empty: it came on, or the run ended before
    """
    warnings: list[str]
    """Warnings of the loop itself"""
    stalled: str
    """A stall of this computer just before the end, which may explain it; empty: none"""
    stalled_s: float | None
    """How long loop and emulated bus waited for this computer [s]; None: they do not wait"""
    guard: dict[str, Any] | None = None
    """None, as the next one: there are several axes, or a defect occurred before it was reported"""
    oscillation: dict[str, Any] | None = None
    """Of the worst axis"""
    delay: dict[str, float] | None = None
    """The longest one"""
    bus: dict[str, Any] | None = None
    axes: dict[str, dict[str, Any]] = field(default_factory=dict)
    """The parts of several axes: guard, oscillation, delay_s, bus, wall_came_on, servo"""
    facts: dict[str, float | None] | None = None
    """The servo's values that the oscillation watch uses; None: there are several"""
    wall_came_on: bool = False
    """All have"""


def add_reports(result: Result, session: Session, on_block: Callable[[], None]) -> None:
    """Add what the axes of a session report, whose bus is closed.

    Args:
        result: The outcome so far.
        session: The session.
        on_block: Called before the guard's reasons are computed.
    """
    indices = range(len(session.axes))
    parts = [_known(session, index) for index in indices]
    try:
        on_block()
        parts = [parts[index] | _computed(session, index, parts[index]) for index in indices]
    except Exception as error:  # noqa: BLE001 - it must not cost what is known of the run
        defect = f"after the run: {defect_text(error)}"
        result.message = "; ".join(filter(None, (result.message, defect)))
        if not isinstance(result.stop_reason, Trip):
            result.stop_reason = Trip.INTERNAL_ERROR
    told, names = all_axes(parts), list(session.configs)
    result.guard, result.oscillation = told.get("guard"), told.get("oscillation")
    result.delay, result.facts = told.get("delay_s"), told.get("servo")
    result.wall_came_on = told["wall_came_on"]
    if told["bus"] is not None:
        schedule = "pipelined" if session.pipelined else "immediate"
        result.bus = told["bus"] | {"schedule": schedule}
    result.axes = {} if "" in names else dict(zip(names, parts, strict=True))


def trouble_text(session: Session, message: str, number: int) -> str:
    """Return why the run ended, as loop, safety and bus say it.

    Args:
        session: The session.
        message: The cause, as far as the loop knows it; empty: the servos' own trouble says it.
        number: Of the axis that ended it, from 1; 0: none did, or there is only one.
    """
    trouble = session.bus.trouble
    axes = [session.axes[number - 1]] if number else session.axes
    message = message or next(filter(None, (axis.safety.found for axis in axes)), "") or trouble
    if trouble and trouble != message and len(session.axes) > 1:  # of another one perhaps
        message += f"; {trouble}"
    return message


def loop_warnings(session: Session, stalled_s: float | None) -> Iterator[str]:
    """Yield the warnings of the loop.

    Args:
        session: The session.
        stalled_s: As of ``Result``.
    """
    most = session.config.safety.max_missed
    worst = max(axis.safety.worst_missed for axis in session.axes)
    if worst > most:
        yield (
            f"in the worst half second the loop missed {worst:.0%} of its periods, more than "
            f"safety.max_missed ({most:.0%}); stiffness and damping follow the served interval "
            "(guard.interval_s)"
        )
    if stalled_s and stalled_s >= NOTED_S:
        yield (
            f"the loop and its emulated bus waited {1e3 * stalled_s:.0f} ms for this computer; a"
            " real servo does not wait: its torque would have been late, or a trip had ended the"
            " run"
        )


def _known(session: Session, index: int) -> dict[str, Any]:
    """Return the report's part on an axis, without what has to be computed."""
    axis, servo = session.axes[index], session.servos[index]
    replies = servo.traffic
    return {
        "bus": replies and asdict(replies.counts[index]) | {"refused": axis.safety.refused},
        "wall_came_on": axis.came_on,
        "servo": {
            name: value if math.isfinite(value := getattr(servo.facts, name)) else None
            for name in ("counts_per_rev", "torque_step", "torque_limit", "stall_torque")
        },
    }


def _computed(session: Session, index: int, known: dict[str, Any]) -> dict[str, Any]:
    """Return the rest of the report's part on an axis."""
    axis, (bins, _) = session.axes[index], session.decided[index]
    config = list(session.configs.values())[index]
    if axis.made is not None:
        config = Config.model_validate_json(axis.made.config)
        bins = bins_of(config, session.servos[index], work=session.work)
    situation, model = bins.situation, config.model
    decision = bins.explained(axis.gains.schedule.index)
    belief, guarded = situation.belief, axis.law.guarded
    elastic = config.servo.kind == "hardware" or belief.transmission_stiffness.high > 0.0
    unknown = guarded and model.flexible_hz is None and elastic
    if guarded:
        reasons = list(_reasons(config, decision, axis, session.loop.missed, known["bus"]))
        guard = decision_report(decision, reasons, now=axis.commanded)
    else:
        guard = decision_report(decision)
    return {
        "guard": guard | {"assumed": assumed(belief, decision) if unknown else None},
        "oscillation": oscillation_report(axis.watch),
        "delay_s": delay_report(situation, decision),
    }


def delay_report(situation: Situation, decision: Decision) -> dict[str, float]:
    """Return the parts of the delay that the guard used, and their sum [s]."""
    inserted, device, total = decision.inserted, situation.belief.delay.high, decision.delay
    # Several bins may share a decision, whose age is that of the oldest; ages are whole ns.
    measured = max(0.0, round(total - inserted - device, 9))
    return {"inserted": inserted, "device": device, "measured": measured, "total": total}


def _reasons(
    config: Config, decision: Decision, axis: Axis, missed: int, bus: Mapping[str, Any] | None
) -> Iterator[str]:
    """Say why less is commanded than requested: an oscillation first, then the guard's reasons."""
    watch, (stiffness, damping) = axis.watch, axis.commanded
    reduced = watch.backstop.wall.reduced[0] < 1.0 and math.isfinite(watch.first_alarm_s)
    if reduced:
        yield (
            f"an oscillation of {watch.frequency_hz:.3g} Hz was found after "
            f"{watch.first_alarm_s:.3g} s: the stiffness is reduced to "
            f"{100 * _share(stiffness, decision.stiffness):.3g} % and the damping to "
            f"{100 * _share(damping, decision.damping):.3g} % of what the guard allows, until "
            "`kill -USR1` requests the full wall; model.delay or another value of model.* may be "
            "wrong"
        )
    yield from decision.reasons
    if decision.period > config.period_ns * 1e-9:
        yield _slower(config, decision, missed, bus)
    if stiffness < decision.stiffness and not reduced:
        yield (
            f"{decision.stiffness:.4g} N·m/rad are allowed, but K rises only at positions where "
            "this adds at most safety.engage_torque, and the shaft has not been there since"
        )


def _slower(config: Config, decision: Decision, missed: int, bus: Mapping[str, Any] | None) -> str:
    """Say that the guard counts a longer period than the grid's, and why."""
    failed, causes = bus["lost"] + bus["corrupt"] + bus["refused"] if bus else 0, []
    if bus and failed:
        causes.append(f"{failed} of {bus['cycles']} replies were lost or broken")
    if missed or not failed:
        causes.append("ticks were late")
    return (
        f"the guard counts a period of {ms(decision.period)} instead of "
        f"{ms(config.period_ns * 1e-9)}, because {' and '.join(causes)}"
    )


def _share(part: float, whole: float) -> float:
    return part / whole if whole else 1.0


def all_axes(parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return what the parts of a report on each axis say together; of one they are its own."""
    if len(parts) == 1:
        return dict(parts[0])
    watched = [part["oscillation"] for part in parts if "oscillation" in part]
    delays = [part["delay_s"] for part in parts if "delay_s" in part]
    counts = [part["bus"] for part in parts if part["bus"] is not None]
    return {
        "oscillation": max(watched, key=_severity, default=None),
        "delay_s": max(delays, key=lambda delay: delay["total"], default=None),
        "wall_came_on": all(part["wall_came_on"] for part in parts),
        "bus": {key: sum(each[key] for each in counts) for key in counts[0]} if counts else None,
    }


def _severity(seen: Mapping[str, Any]) -> tuple[int, float, int]:
    """Return the rank of what a watch has seen."""
    return State[seen["state"].upper()], seen["amplitude_rad"] or 0.0, seen["probes"]


def defect_text(error: Exception) -> str:
    """Name an unexpected error, and the function, file and line in which it was raised.

    It reads no source file: the torque may still be on.
    """
    *_, (frame, line) = traceback.walk_tb(error.__traceback__)
    code = frame.f_code
    file = Path(code.co_filename).name
    return f"{type(error).__name__}: {error} (in {code.co_name}, {file} line {line})"
