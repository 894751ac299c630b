"""Executes a run on the simulated clock: loop, recorder and statistics in one process."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from haptic_wall.controller.processes.plan import Ended, Plan, Tell
from haptic_wall.controller.processes.recorder import Recorder, rows_lacking
from haptic_wall.controller.runtime.session import run_session
from haptic_wall.controller.runtime.session_start import Surroundings
from haptic_wall.controller.runtime.statistics import RunStatistics
from haptic_wall.controller.runtime.telemetry import Telemetry
from haptic_wall.hw.clock import SimulatedClock


def run_inline(plan: Plan, telemetry: Telemetry, tell: Tell = lambda _text: None) -> Ended:
    """Run a plan in this process, on the simulated clock.

    Raises:
        ServoError: The servo could not be started.
    """
    statistics = RunStatistics(telemetry.axes)
    recorder: Recorder | None = None
    warnings: list[str] = []
    lost = False

    def on_block() -> None:
        nonlocal recorder
        statistics.add(telemetry.read(statistics.next_seq)[0])
        if statistics.next_seq and not warnings:
            try:
                if recorder is None:
                    files = plan.log, plan.metadata, plan.axes
                    recorder = Recorder(telemetry, *files, force=plan.force)
                recorder.drain()
            except OSError as error:
                warnings.append(_log_warning(plan.log, error))

    clock = SimulatedClock()
    try:
        result = run_session(
            plan.config,
            clock,
            telemetry,
            plan.duration_s,
            plan.program,
            Surroundings(on_block=on_block, tell=tell),
        )
    finally:
        if recorder is not None:
            try:
                recorder.log.close()
            except OSError as error:
                lost = True
                if not warnings:
                    warnings.append(_log_warning(plan.log, error))
    return Ended(
        result.stop_reason,
        statistics,
        result.ticks,
        result.missed,
        asdict(result),
        warnings=warnings,
        lacking=None if lost else rows_lacking(telemetry.words),
    )


def _log_warning(log: Path, error: OSError) -> str:
    return f"the log {log} is incomplete: {error.strerror or error}; the run went on without it"
