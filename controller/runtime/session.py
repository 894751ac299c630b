"""Runs one session: starts the servos, runs the loop, switches the torque off, reports."""

from __future__ import annotations

import time
from collections.abc import Sequence

from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.runtime.loop import Loop
from haptic_wall.controller.runtime.safety import REASONS, End, StopReason, Trip
from haptic_wall.controller.runtime.session_result import (
    Result,
    add_reports,
    defect_text,
    loop_warnings,
    trouble_text,
)
from haptic_wall.controller.runtime.session_start import Session, Surroundings
from haptic_wall.controller.runtime.telemetry import LoopState, Telemetry, Word
from haptic_wall.controller.runtime.wall_wait import WallWait
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.clock import Clock
from haptic_wall.hw.elastic import ElasticClock
from haptic_wall.hw.errors import (
    ServoHealthError,
    ServoLostError,
    ServoMissingError,
    StrangeServoError,
    TorqueLostError,
)
from haptic_wall.hw.servo import Bus


def run_session(
    config: Config,
    clock: Clock,
    telemetry: Telemetry,
    duration_s: float | None,
    program: Sequence[Phase] = (),
    surroundings: Surroundings | None = None,
) -> Result:
    """Run the wall until the duration is over, a stop is requested, or a trip ends it.

    The result contains errors of the run and of its report. When an error is raised torque is off,
    unless ``Word.STATE`` is ``LoopState.TORQUE_UNKNOWN``: then torque off could not be read back.

    Args:
        config: The effective configuration.
        clock: The loop's clock.
        telemetry: Destination of the rows; holds the stop request.
        duration_s: Time for which the wall is on [s]; None: until stopped.
        program: Rendered in place of the wall; the run ends with it.
        surroundings: Services of the process; None: none.

    Raises:
        ServoError: The servo could not be started.
        PlatformError: ``take_real_time`` refused.
    """
    around = surroundings or Surroundings()
    session = Session(config, clock, telemetry, program, around)
    try:
        session.prepare()
        session.start()
        result = _run(session, clock, telemetry, duration_s, around)
    except BaseException as error:
        # A servo that never replied was never driven.
        if session.torque_asked and not isinstance(error, (ServoMissingError, StrangeServoError)):
            _stop(session.bus, clock, telemetry)
        raise
    finally:
        session.bus.close()
    add_reports(result, session, around.on_block)
    return result


def _run(
    session: Session,
    clock: Clock,
    telemetry: Telemetry,
    duration_s: float | None,
    around: Surroundings,
) -> Result:
    """Run the loop until the end, and switch the torque off; return the outcome so far."""
    began_s, loop = time.monotonic(), session.loop
    waiting = WallWait(loop, session.configs, around.tell)
    ages = session.bus.traffic is not None or session.config.loop.clock == "monotonic"
    warm_up_s = session.config.loop.warm_up_s if ages else None  # nothing to measure
    reason, message, servo_id = _served(loop, warm_up_s, duration_s, waiting)
    if number := session.number(servo_id):
        telemetry.words[Word.STOP_AXIS] = number
    telemetry.words[Word.REASON] = 1 + REASONS.index(reason)
    real_s = time.monotonic() - began_s
    stall_s = loop.stall_s(clock.now_ns())
    torque_off = _stop(session.bus, clock, telemetry)
    stalled_s = None
    if isinstance(clock, ElasticClock):
        clock.release()
        stalled_s = loop.stalled_s
    number = telemetry.words[Word.STOP_AXIS]
    return Result(
        stop_reason=reason,
        message=trouble_text(session, message, number),
        ticks=loop.cycle.ticks,
        missed=loop.missed,
        elapsed_s=loop.elapsed_s,
        real_s=real_s,
        grid_hz=1e9 / loop.period_ns,
        torque_off=torque_off,
        stop_axis=list(session.configs)[number - 1] if number else None,
        checks=session.checks,
        waited_for=waiting.lacking(),
        warnings=list(loop_warnings(session, stalled_s)),
        stalled=f"this computer stalled for {stall_s * 1e3:.0f} ms" if stall_s else "",
        stalled_s=stalled_s,
    )


def _served(
    loop: Loop, warm_up_s: float | None, duration_s: float | None, waiting: WallWait
) -> tuple[StopReason, str, int | None]:
    """Warm up, switch the wall on, run.

    Args:
        loop: The loop.
        warm_up_s: Duration of the warm-up [s]; None: there is none.
        duration_s: As of ``run_session``.
        waiting: Waits until the wall may come on.

    Returns:
        The stop reason, a message if needed, and the id of the servo that is at fault, if any.
    """
    try:
        reason = None if warm_up_s is None else loop.serve(warm_up_s)
        if reason is None:
            reason = waiting(duration_s)
        loop.cycle.wall_on()
        loop.begin()
        return reason or loop.serve(duration_s) or End.DURATION, "", None
    except ServoHealthError as error:
        return Trip.SERVO_HEALTH, str(error), error.id
    except TorqueLostError as error:
        return Trip.TORQUE_LOST, str(error), error.id
    except ServoLostError as error:
        return Trip.SERVO_LOST, str(error), error.id
    except Exception as error:  # noqa: BLE001 - whatever it is, the torque must go off
        return Trip.INTERNAL_ERROR, defect_text(error), None


def _stop(bus: Bus, clock: Clock, telemetry: Telemetry) -> bool:
    """Switch the torque off; return whether that was read back, and set ``Word.STATE``."""
    words = telemetry.words
    words[Word.HEARTBEAT_NS] = clock.now_ns()  # the supervisor's time-out starts here
    words[Word.STATE] = LoopState.STOPPING
    torque_off = bus.stop()
    words[Word.STATE] = LoopState.TORQUE_OFF if torque_off else LoopState.TORQUE_UNKNOWN
    return torque_off
