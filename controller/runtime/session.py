"""Runs one session: builds the loop's parts, checks the servo, runs the loop, ends torque off."""

from __future__ import annotations

import math
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from haptic_wall.controller.detector.backstop import Shared
from haptic_wall.controller.detector.watch import oscillation_report
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.runtime.assembly import (
    Decided,
    assembled,
    decision_in_force,
    guard_decisions,
    situation_of,
)
from haptic_wall.controller.runtime.cycle import Cycle, is_pipelined
from haptic_wall.controller.runtime.deadlines import waiter_for
from haptic_wall.controller.runtime.handover import Inbox, KnownServo
from haptic_wall.controller.runtime.loop import Loop
from haptic_wall.controller.runtime.realtime import freeze_garbage
from haptic_wall.controller.runtime.safety import End, StopReason, Trip
from haptic_wall.controller.runtime.session_report import (
    all_axes,
    delay_report,
    guard_report,
    missed_warnings,
    stall_warnings,
)
from haptic_wall.controller.runtime.telemetry import LoopState, Telemetry, Word
from haptic_wall.controller.runtime.wall_wait import WallWait
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.clock import Clock, SimulatedClock
from haptic_wall.hw.elastic import ElasticClock
from haptic_wall.hw.errors import (
    GivenUpError,
    ServoError,
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
        self._configs = config.each
        self._clock = clock
        self._telemetry = telemetry
        self._program = program
        self._around = surroundings
        self._simulated = isinstance(clock, SimulatedClock)
        self._started = False
        self._work = Work()
        self._checks: list[Check] = []
        self._inbox = Inbox(telemetry)
        self.bus = surroundings.open_bus(config.servos(), clock, surroundings.port)
        self.bus.given_up = lambda: bool(telemetry.words[Word.STOP])

    def prepare(self) -> None:
        """Do all long computations: a started servo needs a frame within its watchdog's time."""
        self._decide()
        freeze_garbage()
        self._around.take_real_time()
        self._wait = waiter_for(self._clock, self._config.period_ns)

    def _decide(self) -> None:
        """Compute the guard's decisions from the servos' known values."""
        self._know()
        known: dict[str, Decided] = {}  # equal axes are decided once
        self._decided = []
        for config, servo in self._each():
            asked = repr((config.request(servo.facts.position_step), situation_of(config, servo)))
            if asked not in known:
                known[asked] = guard_decisions(
                    config, servo, program=bool(self._program), work=self._work
                )
            self._decided.append(known[asked])

    def _know(self) -> None:
        """Take the facts of the servos, and the longest of their delays.

        From the shortest of all on: on a flexible transmission that may be the less safe one.
        """
        traffic, simulated = self.bus.traffic, self._simulated
        delays = [config.belief().delay for config in self._configs.values()]
        lag = max(delays, key=lambda delay: delay.high)
        lag = replace(lag, low=min(delay.low for delay in delays))
        self._servos = [KnownServo(each, traffic, simulated, lag) for each in self.bus.facts]

    def _each(self) -> Iterator[tuple[Config, KnownServo]]:
        """Return configuration and servo of each axis."""
        return zip(self._configs.values(), self._servos, strict=True)

    def start(self) -> None:
        """Check the servo, switch its torque on, and build the cycle; the loop then runs."""
        config, bus, telemetry = self._config, self.bus, self._telemetry
        limits, asked = [servo.facts.torque_limit for servo in self._servos], config.servo.schedule
        telemetry.words[Word.STATE] = LoopState.STARTING  # first: see Supervisor
        if not telemetry.words[Word.STOP]:  # no torque is switched on for a session that is to stop
            self._started = True
            if isinstance(self._clock, ElasticClock):
                self._clock.engage()
            with suppress(GivenUpError):
                self._start_bus(limits)
        self._pipelined = is_pipelined(asked, bus.traffic, config.period_ns * 1e-9)
        if self._pipelined and asked == "auto" and bus.traffic is not None:
            held_ms = bus.traffic.longest_s * 1e3
            self._around.tell(f"schedule pipelined: the adapter holds replies for {held_ms:.2g} ms")
        self._know()
        shared = Shared()
        self._axes = [
            assembled(one, servo, telemetry, self._inbox, shared, decided, self._program)
            for (one, servo), decided in zip(self._each(), self._decided, strict=True)
        ]
        self._inbox.tell(self._servos)
        parts = (self._clock, bus, self._axes, telemetry.words, self._inbox, config.period_ns)
        self._loop = Loop(
            Cycle(*parts, pipelined=self._pipelined),
            self._wait,
            self._clock,
            telemetry,
            config.period_ns,
            self._between_ticks,
            self._around.read_key,
        )
        telemetry.words[Word.HEARTBEAT_NS] = self._clock.now_ns()
        telemetry.words[Word.STATE] = LoopState.RUNNING

    def _start_bus(self, limits: list[float]) -> None:
        """Switch the torques on; decide again if a torque limit is none of ``limits`` [N·m].

        Raises:
            GivenUpError: The session is to stop; all torques are off.
        """
        bus = self.bus
        try:
            self._checks = self._named(bus.start())
        except ServoError as error:
            self._name_axis(error)
            raise
        if [each.torque_limit for each in bus.facts] != limits:  # their own Current Limits
            self._decide()
        passed = f", {len(self._checks)} start-up checks passed" if self._checks else ""
        names = ", ".join(self._configs) or bus.facts[0].name
        self._around.tell(f"{names}: torque is on{passed}")

    def _named(self, checks: list[list[Check]]) -> list[Check]:
        """Return the checks of all servos; the names of several have their axis before them."""
        return [
            replace(check, name=f"{axis}: {check.name}") if axis else check
            for axis, some in zip(self._configs, checks, strict=True)
            for check in some
        ]

    def _number(self, servo_id: int | None) -> int:
        """Return the number of the axis whose servo has this id, from 1; 0: there is only one."""
        ids = [one.servo.id for one in self._configs.values()]
        return ids.index(servo_id) + 1 if servo_id in ids and len(ids) > 1 else 0

    def _name_axis(self, error: ServoError) -> None:
        """Let an error about the servo of one of several axes name it."""
        if number := self._number(error.id):
            axis, told = list(self._configs)[number - 1], error.problem
            error.problem = replace(told, what=f"{axis}: {told.what}")
            error.args = (str(error.problem),)

    def _between_ticks(self) -> None:
        """Pass on the health of the hottest servo, and call ``on_block``."""
        if health := self.bus.health():
            volts, celsius = max(health, key=lambda each: each[1])
            self._telemetry.words[Word.TEMPERATURE_MC] = round(1e3 * celsius)
            self._telemetry.words[Word.SUPPLY_MV] = round(1e3 * volts)
        self._around.on_block()

    def run(self, duration_s: float | None) -> None:
        """Run the loop until the end, and switch the torque off."""
        began_s = time.monotonic()
        self._waiting = WallWait(self._loop, self._configs, self._around.tell)
        self._reason, self._message, servo_id = _run(
            self._loop, self._config, self.bus.traffic, duration_s, self._waiting
        )
        if number := self._number(servo_id):
            self._telemetry.words[Word.STOP_AXIS] = number
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
        reason, defect, loop = self._reason, "", self._loop
        parts = [self._known(index) for index in range(len(self._axes))]
        try:
            self._around.on_block()
            parts = [part | self._computed(index, part) for index, part in enumerate(parts)]
        except Exception as error:  # noqa: BLE001 - it must not cost what is known of the run
            defect = f"after the run: {defect_text(error)}"
            reason = reason if isinstance(reason, Trip) else Trip.INTERNAL_ERROR
        told, number = all_axes(parts), self._telemetry.words[Word.STOP_AXIS]
        if (bus := told["bus"]) is not None:
            bus = bus | {"schedule": "pipelined" if self._pipelined else "immediate"}
        stalled_s = loop.stalled_s if isinstance(self._clock, ElasticClock) else None
        worst_missed = max(axis.safety.worst_missed for axis in self._axes)
        return Result(
            stop_reason=reason,
            stop_axis=list(self._configs)[number - 1] if number else None,
            message="; ".join(filter(None, (self._told(number), defect))),
            ticks=loop.cycle.ticks,
            missed=loop.missed,
            elapsed_s=loop.elapsed_s,
            real_s=self._real_s,
            grid_hz=1e9 / loop.period_ns,
            guard=told.get("guard"),
            oscillation=told.get("oscillation"),
            delay=told.get("delay_s"),
            bus=bus,
            torque_off=self._torque_off,
            axes={} if "" in self._configs else dict(zip(self._configs, parts, strict=True)),
            checks=self._checks,
            facts=told.get("servo"),
            wall_came_on=told["wall_came_on"],
            waited_for=self._waiting.lacking(),
            warnings=[*missed_warnings(self._config, worst_missed), *stall_warnings(stalled_s)],
            stalled=self._stalled,
            stalled_s=stalled_s,
        )

    def _told(self, number: int) -> str:
        """Return why the run ended, as loop, safety and bus say it.

        Args:
            number: Of the axis that ended it, from 1; 0: none did.
        """
        trouble = self.bus.trouble
        axes = [self._axes[number - 1]] if number else self._axes
        found = next(filter(None, (axis.safety.found for axis in axes)), "")
        message = self._message or found or trouble
        if trouble and trouble != message and len(self._axes) > 1:  # of another one perhaps
            message += f"; {trouble}"
        return message

    def _known(self, index: int) -> dict[str, Any]:
        """Return the report's part on an axis, without what has to be computed."""
        axis, servo = self._axes[index], self._servos[index]
        return {
            "bus": _counts(servo.traffic, index, axis.safety.refused),
            "wall_came_on": axis.came_on,
            "servo": _facts(servo.facts),
        }

    def _computed(self, index: int, known: dict[str, Any]) -> dict[str, Any]:
        """Return the rest of the report's part on an axis."""
        axis, servo = self._axes[index], self._servos[index]
        config, schedule = list(self._configs.values())[index], axis.gains.schedule
        if axis.made is not None:
            config = Config.model_validate_json(axis.made.config)
        situation, decided = situation_of(config, servo), self._decided[index]
        decision = decision_in_force(config, servo, decided, schedule.index, self._work)
        missed = self._telemetry.words[Word.MISSED]
        return {
            "guard": guard_report(config, decision, axis, missed, situation, known["bus"]),
            "oscillation": oscillation_report(axis.watch),
            "delay_s": delay_report(situation, decision),
        }


def _stop(bus: Bus, clock: Clock, telemetry: Telemetry) -> bool:
    """Switch the torque off; return whether that was read back, and set ``Word.STATE``."""
    words = telemetry.words
    words[Word.HEARTBEAT_NS] = clock.now_ns()  # the supervisor's time-out starts here
    words[Word.STATE] = LoopState.STOPPING
    torque_off = bus.stop()
    words[Word.STATE] = LoopState.TORQUE_OFF if torque_off else LoopState.TORQUE_UNKNOWN
    return torque_off


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


def _run(
    loop: Loop,
    config: Config,
    traffic: Traffic | None,
    duration_s: float | None,
    waiting: WallWait,
) -> tuple[StopReason, str, int | None]:
    """Warm up, switch the wall on, run.

    Returns:
        The stop reason, a message if needed, and the id of the servo that is at fault, if any.
    """
    try:
        reason = None
        if traffic or config.loop.clock == "monotonic":
            reason = loop.serve(config.loop.warm_up_s)
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
