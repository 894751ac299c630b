"""One run of the loop: build its parts, check the servo, run the grid, end with torque off."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from controller.assembly import (
    decision_in_force,
    guard_schedule,
    most_injected,
    rehearsal,
    rendered,
    situation_of,
    tick_parts,
)
from controller.defect import defect_text
from controller.detector.watch import oscillation_report
from controller.grid import Grid
from controller.lateness.machine_setup import Found
from controller.lateness.ticks import LateTicks
from controller.loop import waiter_for
from controller.program import Phase
from controller.realtime import freeze_garbage, reserve_memory
from controller.safety import Trip
from controller.session_report import (
    delay_report,
    guard_report,
    missed_warnings,
    trip_figures,
)
from controller.settings.config import Config
from controller.telemetry import State, Telemetry, Word
from controller.tick import Tick
from controller.wall_wait import WallWait
from hw.clock import Clock, SimulatedClock
from hw.errors import (
    ServoHealthError,
    ServoLostError,
    ServoMissingError,
    StrangeServoError,
    TorqueLostError,
)
from hw.open import open_servo
from hw.servo import Check, Servo
from hw.settings import ServoSettings

_REPLIES = 3.0
"""Replies that the warm-up waits for at least"""


@dataclass(frozen=True, slots=True)
class Result:
    """How a run ended; everything in it can be sent as JSON."""

    stop_reason: str
    message: str
    """What the program itself wants to add; empty mostly"""
    ticks: int
    missed: int
    elapsed_s: float
    real_s: float
    """What that took in real time, start-up not counted [s]"""
    grid_hz: float
    guard: dict[str, Any] | None
    """None, as the next two: a defect came before it was told"""
    oscillation: dict[str, Any] | None
    delay: dict[str, float] | None
    bus: dict[str, int] | None
    timing: dict[str, Any] | None
    """Which ticks were late, and why; None: nobody looked, or a defect"""
    torque_off: bool
    checks: list[Check] = field(default_factory=list)
    setup: list[Found] = field(default_factory=list)
    """The machine's, where the loop has a process of its own"""
    facts: dict[str, float | None] = field(default_factory=dict)
    """Of the servo, which the watch counts with; None: not known"""
    wall_came_on: bool = False
    waited_for: str = ""
    """What a wall that never came on waited for; empty: it came on, or did not get so far"""
    warnings: list[str] = field(default_factory=list)
    """What the loop itself warns of"""


def run_session(
    config: Config,
    clock: Clock,
    telemetry: Telemetry,
    duration_s: float | None,
    port: int | None = None,
    program: Sequence[Phase] = (),
    on_block: Callable[[], None] = lambda: None,
    tell: Callable[[str], None] = lambda _text: None,
    prepare: Callable[[], LateTicks | None] = lambda: None,
    opener: Callable[[ServoSettings, Clock, int | None], Servo] = open_servo,
) -> Result:
    """Run the wall until the duration is over, a stop is asked for, or a trip ends it.

    What goes wrong in the run, or when it is reported, is told in the result. Where an error is
    raised torque is off, unless ``Word.STATE`` is ``State.TORQUE_UNKNOWN``: then that could not be
    read back.

    Args:
        config: The effective configuration.
        clock: What the loop runs on.
        telemetry: Where rows go, and where a stop is asked for.
        duration_s: How long the wall is on [s]; None: until stopped.
        port: Descriptor of the open serial port, where there is one.
        program: What is rendered in place of the wall; the run ends with it.
        on_block: Called now and then between ticks, where the same process must also record.
        tell: Called with what a person should know before the wall is on.
        prepare: Called when all that takes long is done and the servo is about to be started: the
            place to take real-time scheduling, which must not be held through long computations.
            Who it returns is told of late ticks.
        opener: Opens the servo; for rehearsals that have a hand on what is emulated.

    Raises:
        ServoError: The servo could not be started.
        PlatformError: ``prepare`` refused.
    """
    servo = opener(config.servo_settings(), clock, port)
    started = False
    try:
        # All that takes long comes before the start: a started servo wants to hear something
        # within every period of its Bus Watchdog.
        limit = servo.facts.torque_limit
        simulated = isinstance(clock, SimulatedClock)
        schedule = guard_schedule(config, servo, simulated)
        injected = most_injected(config, servo, schedule)
        rehearsed = None
        if config.realtime.rehearse and not simulated:
            rehearsed = rehearsal(config, servo, schedule, injected, program)
        freeze_garbage()
        reserve_memory()
        late = prepare()
        waiter = waiter_for(clock, _spin_ns(config), config.period_ns, rehearsed)
        checks: list[Check] = []
        if not telemetry.words[Word.STOP]:  # else no torque is switched on only to end at once
            started = True
            checks = servo.start()
            # The servo's own Current Limit is another, or replies come later than was thought.
            if servo.facts.torque_limit != limit or servo.facts.reply_s:
                schedule = guard_schedule(config, servo, simulated)
                injected = most_injected(config, servo, schedule)
            passed = f", {len(checks)} start-up checks passed" if checks else ""
            tell(f"{servo.facts.name}: torque is on{passed}")
        law = rendered(config, servo, program)
        parts = tick_parts(config, clock, servo, telemetry, schedule, law, injected)
        watch = parts.motion.watch
        tick = Tick(parts)
        grid = Grid(tick, waiter, clock, telemetry, servo, config.period_ns, on_block, late)
        telemetry.words[Word.HEARTBEAT_NS] = clock.now_ns()
        telemetry.words[Word.STATE] = State.RUNNING
        began_s = time.monotonic()
        waiting = WallWait(grid, config, parts, tell)
        reason, message = _run(grid, config, servo, duration_s, waiting)
        real_s = time.monotonic() - began_s
        torque_off = _stop(servo, clock, telemetry)
    except BaseException as error:
        # What never answered, or is nothing we know, was never driven.
        if started and not isinstance(error, (ServoMissingError, StrangeServoError)):
            _stop(servo, clock, telemetry)
        raise
    finally:
        servo.close()
    result = Result(
        stop_reason=reason,
        message=message or trip_figures(tick.trip, parts) or servo.trouble,
        ticks=tick.ticks,
        missed=grid.missed,
        elapsed_s=grid.elapsed_s,
        real_s=real_s,
        grid_hz=1e9 / grid.period_ns,
        guard=None,
        oscillation=None,
        delay=None,
        bus=asdict(servo.counts) if servo.facts.has_bus else None,
        timing=None,
        torque_off=torque_off,
        checks=checks,
        facts=_facts(servo),
        wall_came_on=tick.came_on,
        waited_for=waiting.lacking(),
    )
    try:
        on_block()
        if rehearsed is not None and rehearsed.fault:
            tell(f"the tick's rehearsal failed, so ticks took longer: {rehearsed.fault}")
        decision = decision_in_force(config, servo, schedule, tick.commanded[0])
        return replace(
            result,
            guard=guard_report(
                config, decision, tick, law, watch, situation_of(config, servo), servo.counts
            ),
            oscillation=oscillation_report(watch),
            delay=delay_report(config, decision, schedule.age_ns),
            timing=None if late is None else late.report(),
            warnings=missed_warnings(config, parts.missed),
        )
    except Exception as error:  # noqa: BLE001 - it must not cost what is known of the run
        return _with_defect(result, error)


def _stop(servo: Servo, clock: Clock, telemetry: Telemetry) -> bool:
    """Switch the torque off; whether that was read back, which ``Word.STATE`` tells too."""
    words = telemetry.words
    words[Word.HEARTBEAT_NS] = clock.now_ns()  # off the grid one is overdue some time after it
    words[Word.STATE] = State.STOPPING
    torque_off = servo.stop()
    words[Word.STATE] = State.TORQUE_OFF if torque_off else State.TORQUE_UNKNOWN
    return torque_off


def _facts(servo: Servo) -> dict[str, float | None]:
    facts = servo.facts
    return {
        "counts_per_rev": facts.counts_per_rev,
        "torque_limit": facts.torque_limit if math.isfinite(facts.torque_limit) else None,
        "stall_torque": facts.stall_torque if math.isfinite(facts.stall_torque) else None,
    }


def _with_defect(result: Result, error: Exception) -> Result:
    """A run whose report met an error that nobody foresaw; a trip before it stays the reason."""
    tripped = result.stop_reason.startswith("trip:")
    return replace(
        result,
        stop_reason=result.stop_reason if tripped else f"trip:{Trip.INTERNAL_ERROR}",
        message="; ".join(filter(None, (result.message, f"after the run: {defect_text(error)}"))),
    )


def _spin_ns(config: Config) -> int | None:
    spin_us = config.realtime.spin_us
    return None if spin_us is None else round(spin_us * 1000.0)


def _run(
    grid: Grid,
    config: Config,
    servo: Servo,
    duration_s: float | None,
    waiting: WallWait,
) -> tuple[str, str]:
    """Warm up, switch the wall on, run; why it ended, and a message where one is needed."""
    try:
        reason = None
        if servo.facts.has_bus or config.loop.clock == "monotonic":
            # Where replies take long, until some have come: the age and the place are known then.
            reason = grid.serve(max(config.loop.warm_up_s, _REPLIES * servo.facts.reply_s))
        if reason is None:
            reason = waiting(duration_s)
        grid.tick.wall_on()
        grid.begin()
        return reason or grid.serve(duration_s) or "duration", ""
    except ServoHealthError as error:
        return f"trip:{Trip.SERVO_HEALTH}", str(error)
    except TorqueLostError as error:
        return f"trip:{Trip.TORQUE_LOST}", str(error)
    except ServoLostError as error:
        return f"trip:{Trip.SERVO_LOST}", str(error)
    except Exception as error:  # noqa: BLE001 - whatever it is, the torque must go off
        return f"trip:{Trip.INTERNAL_ERROR}", defect_text(error)
