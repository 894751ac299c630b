"""Runs one session: builds the loop's parts, checks the servo, runs the loop, ends torque off."""

from __future__ import annotations

import math
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from haptic_wall.controller.detector.watch import oscillation_report
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.runtime.assembly import (
    assembled,
    decision_in_force,
    gain_schedule,
    guard_decisions,
    rendered,
    situation_of,
)
from haptic_wall.controller.runtime.cycle import Cycle, is_pipelined
from haptic_wall.controller.runtime.deadlines import waiter_for
from haptic_wall.controller.runtime.handover import KnownServo
from haptic_wall.controller.runtime.loop import Loop
from haptic_wall.controller.runtime.realtime import freeze_garbage, reserve_memory
from haptic_wall.controller.runtime.safety import End, StopReason, Trip
from haptic_wall.controller.runtime.session_report import (
    delay_report,
    guard_report,
    missed_warnings,
    stall_warnings,
)
from haptic_wall.controller.runtime.telemetry import LoopState, Telemetry, Word
from haptic_wall.controller.runtime.wall_wait import WallWait
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.capabilities import HasHealth, HasTrouble
from haptic_wall.hw.clock import Clock, SimulatedClock
from haptic_wall.hw.elastic import ElasticClock
from haptic_wall.hw.errors import (
    ServoHealthError,
    ServoLostError,
    ServoMissingError,
    StrangeServoError,
    TorqueLostError,
)
from haptic_wall.hw.open import open_bus
from haptic_wall.hw.servo import Bus, Check, Facts, Traffic
from haptic_wall.hw.settings import ServoSettings


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
    """None, as the next one: a defect occurred before it was reported"""
    oscillation: dict[str, Any] | None
    delay: dict[str, float] | None
    bus: dict[str, Any] | None
    torque_off: bool
    checks: list[Check] = field(default_factory=list)
    setup: list[Check] = field(default_factory=list)
    """The machine's settings, where the loop has a process of its own"""
    facts: dict[str, float | None] = field(default_factory=dict)
    """The servo's values that the oscillation watch uses; None: not known"""
    wall_came_on: bool = False
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
class Surroundings:
    """Services that the process around a session provides."""

    port: int | None = None
    """Descriptor of the open serial port, if any"""
    tell: Callable[[str], None] = lambda _text: None
    """Called with messages for a person before the wall is on"""
    on_block: Callable[[], None] = lambda: None
    """Called periodically between ticks, where the same process must also record"""
    take_real_time: Callable[[], None] = lambda: None
    """Called after the long computations, just before the servo starts: real-time scheduling must
    not be held through them"""
    read_key: Callable[[int], float] | None = None
    """Reads the dead man's key, as for ``Loop``"""
    open_bus: Callable[[Sequence[ServoSettings], Clock, int | None], Bus] = open_bus
    """Opens the bus; replaced by tests and experiments that change an emulated one"""


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
    session = _Session(config, clock, telemetry, program, surroundings or Surroundings())
    try:
        session.prepare()
        session.start()
        session.run(duration_s)
    except BaseException as error:
        session.abandon(error)
        raise
    finally:
        session.bus.close()
    return session.finish()


class _Session:
    """A bus with its axes, from opening to the report."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        telemetry: Telemetry,
        program: Sequence[Phase],
        surroundings: Surroundings,
    ) -> None:
        self._config = config
        self._clock = clock
        self._telemetry = telemetry
        self._program = program
        self._around = surroundings
        self._simulated = isinstance(clock, SimulatedClock)
        self._started = False
        self._work = Work()
        self._checks: list[Check] = []
        self.bus = surroundings.open_bus(config.servos(), clock, surroundings.port)

    def prepare(self) -> None:
        """Do all long computations: a started servo needs a frame within its watchdog's time."""
        self._decide()
        freeze_garbage()
        if not self._simulated:
            reserve_memory()
        self._around.take_real_time()
        self._wait = waiter_for(self._clock, self._config.realtime.spin_us, self._config.period_ns)

    def _decide(self) -> None:
        """Compute the guard's decisions from the servo's known values."""
        (facts,) = self.bus.facts
        self._servo = KnownServo(facts, self.bus.traffic, self._simulated)
        self._decided = guard_decisions(
            self._config, self._servo, program=bool(self._program), work=self._work
        )

    def start(self) -> None:
        """Check the servo, switch its torque on, and build the cycle; the loop then runs."""
        config, bus, telemetry = self._config, self.bus, self._telemetry
        limit, asked = self._servo.facts.torque_limit, config.servo.schedule
        if not telemetry.words[Word.STOP]:  # no torque is switched on for a session that is to stop
            self._started = True
            if isinstance(self._clock, ElasticClock):
                self._clock.engage()
            (self._checks,) = bus.start()
            if bus.facts[0].torque_limit != limit:  # its own Current Limit: decided at once
                self._decide()
            passed = f", {len(self._checks)} start-up checks passed" if self._checks else ""
            self._around.tell(f"{bus.facts[0].name}: torque is on{passed}")
        self._pipelined = is_pipelined(asked, bus.traffic, config.period_ns * 1e-9)
        if self._pipelined and asked == "auto" and bus.traffic is not None:
            held_ms = bus.traffic.longest_s * 1e3
            self._around.tell(f"schedule pipelined: the adapter holds replies for {held_ms:.2g} ms")
        self._servo = replace(self._servo, facts=bus.facts[0])
        self._axis = assembled(
            config,
            self._servo,
            telemetry,
            gain_schedule(config, self._decided),
            rendered(config, self._servo.facts, self._program),
        )
        self._axis.inbox.tell(self._servo)
        self._health = bus if isinstance(bus, HasHealth) else None
        words, period_ns = telemetry.words, config.period_ns
        self._loop = Loop(
            Cycle(self._clock, bus, [self._axis], words, period_ns, pipelined=self._pipelined),
            self._wait,
            self._clock,
            telemetry,
            config.period_ns,
            self._between_ticks,
            self._around.read_key,
        )
        telemetry.words[Word.HEARTBEAT_NS] = self._clock.now_ns()
        telemetry.words[Word.STATE] = LoopState.RUNNING

    def _between_ticks(self) -> None:
        """Pass on the servo's health, and call ``on_block``."""
        if self._health is not None:
            ((volts, celsius),) = self._health.health()
            self._telemetry.words[Word.TEMPERATURE_MC] = round(1e3 * celsius)
            self._telemetry.words[Word.SUPPLY_MV] = round(1e3 * volts)
        self._around.on_block()

    def run(self, duration_s: float | None) -> None:
        """Run the loop until the end, and switch the torque off."""
        began_s = time.monotonic()
        self._waiting = WallWait(self._loop, self._config, self._around.tell)
        self._reason, self._message = _run(
            self._loop, self._config, self._servo.traffic, duration_s, self._waiting
        )
        self._real_s = time.monotonic() - began_s
        recent_s = self._loop.stall_s(self._clock.now_ns())
        self._stalled = f"this computer stalled for {recent_s * 1e3:.0f} ms" if recent_s else ""
        self._torque_off = _stop(self.bus, self._clock, self._telemetry)
        if isinstance(self._clock, ElasticClock):
            self._clock.release()

    def abandon(self, error: BaseException) -> None:
        """Switch the torque off after an error; a servo that never replied was never driven."""
        if self._started and not isinstance(error, (ServoMissingError, StrangeServoError)):
            _stop(self.bus, self._clock, self._telemetry)

    def finish(self) -> Result:
        """Return the outcome; the servo is closed."""
        axis, cycle, facts = self._axis, self._loop.cycle, self.bus.facts[0]
        trouble = self.bus.trouble if isinstance(self.bus, HasTrouble) else ""
        result = Result(
            stop_reason=self._reason,
            message=self._message or axis.safety.found or trouble,
            ticks=cycle.ticks,
            missed=self._loop.missed,
            elapsed_s=self._loop.elapsed_s,
            real_s=self._real_s,
            grid_hz=1e9 / self._loop.period_ns,
            guard=None,
            oscillation=None,
            delay=None,
            bus=_bus(self._servo.traffic, axis.safety.refused, pipelined=self._pipelined),
            torque_off=self._torque_off,
            checks=self._checks,
            facts=_facts(facts),
            wall_came_on=axis.came_on,
            waited_for=self._waiting.lacking(),
            stalled=self._stalled,
            stalled_s=self._loop.stalled_s if isinstance(self._clock, ElasticClock) else None,
        )
        try:
            return self._reported(result)
        except Exception as error:  # noqa: BLE001 - it must not cost what is known of the run
            return _with_defect(result, error)

    def _reported(self, result: Result) -> Result:
        """Add the report's computed parts to a result."""
        servo, axis = self._servo, self._axis
        schedule, made = axis.gains.schedule, axis.inbox.made
        config = self._config if made is None else Config.model_validate_json(made.config)
        self._around.on_block()
        decision = decision_in_force(config, servo, self._decided, schedule.index, self._work)
        return replace(
            result,
            guard=guard_report(
                config, decision, self._loop.cycle, situation_of(config, servo), result.bus
            ),
            oscillation=oscillation_report(axis.watch),
            delay=delay_report(config, decision, schedule.age_ns),
            warnings=[
                *missed_warnings(config, axis.safety.worst_missed),
                *stall_warnings(result.stalled_s),
            ],
        )


def _stop(bus: Bus, clock: Clock, telemetry: Telemetry) -> bool:
    """Switch the torque off; return whether that was read back, and set ``Word.STATE``."""
    words = telemetry.words
    words[Word.HEARTBEAT_NS] = clock.now_ns()  # the supervisor's time-out starts here
    words[Word.STATE] = LoopState.STOPPING
    torque_off = bus.stop()
    words[Word.STATE] = LoopState.TORQUE_OFF if torque_off else LoopState.TORQUE_UNKNOWN
    return torque_off


def _bus(traffic: Traffic | None, refused: int, *, pipelined: bool) -> dict[str, Any] | None:
    """Return the counts of a bus, and the schedule that ``auto`` has chosen or that was set."""
    if traffic is None:
        return None
    schedule = "pipelined" if pipelined else "immediate"
    return asdict(traffic.counts[0]) | {"refused": refused, "schedule": schedule}


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


def _with_defect(result: Result, error: Exception) -> Result:
    """Add an unexpected error of the report to a result; an earlier trip stays the reason."""
    tripped = isinstance(result.stop_reason, Trip)
    return replace(
        result,
        stop_reason=result.stop_reason if tripped else Trip.INTERNAL_ERROR,
        message="; ".join(filter(None, (result.message, f"after the run: {defect_text(error)}"))),
    )


def _run(
    loop: Loop,
    config: Config,
    traffic: Traffic | None,
    duration_s: float | None,
    waiting: WallWait,
) -> tuple[StopReason, str]:
    """Warm up, switch the wall on, run; return the stop reason, and a message if needed."""
    try:
        reason = None
        if traffic or config.loop.clock == "monotonic":
            reason = loop.serve(config.loop.warm_up_s)
        if reason is None:
            reason = waiting(duration_s)
        loop.cycle.wall_on()
        loop.begin()
        return reason or loop.serve(duration_s) or End.DURATION, ""
    except ServoHealthError as error:
        return Trip.SERVO_HEALTH, str(error)
    except TorqueLostError as error:
        return Trip.TORQUE_LOST, str(error)
    except ServoLostError as error:
        return Trip.SERVO_LOST, str(error)
    except Exception as error:  # noqa: BLE001 - whatever it is, the torque must go off
        return Trip.INTERNAL_ERROR, defect_text(error)
