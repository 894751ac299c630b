"""Starts a session: opens the bus, decides what the guard allows, switches the torque on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from haptic_wall.controller.detector.backstop import Shared
from haptic_wall.controller.guard.bins import Bins
from haptic_wall.controller.guard.schedule import GainTable
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.runtime.assembly import (
    assembled,
    bins_of,
    clip_of,
    gain_table,
    situation_of,
)
from haptic_wall.controller.runtime.axis import Axis
from haptic_wall.controller.runtime.cycle import Cycle
from haptic_wall.controller.runtime.deadlines import waiter_for
from haptic_wall.controller.runtime.handover import Inbox, KnownServo
from haptic_wall.controller.runtime.loop import Loop
from haptic_wall.controller.runtime.realtime import freeze_garbage
from haptic_wall.controller.runtime.telemetry import LoopState, Telemetry, Word
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.shares import COLLECT_SHARE
from haptic_wall.hw.clock import Clock
from haptic_wall.hw.elastic import ElasticClock
from haptic_wall.hw.errors import GivenUpError, ServoError
from haptic_wall.hw.open import open_bus
from haptic_wall.hw.servo import Bus, Check
from haptic_wall.hw.settings import ServoSettings


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


class Session:
    """A bus with its axes, from opening to the loop that is ready to run.

    Attributes:
        bus: The servos.
        config: The effective configuration.
        configs: That of each axis, by its name; the name of a single one is empty.
        servos: Of each axis.
        decided: The bins that the guard decides for, and its numbers, for each axis.
        axes: The axes; there are some after ``start``, like the next ones.
        loop: Serves their ticks.
        pipelined: Requests are sent in the period before.
        checks: Start-up checks of all servos.
        work: What the guard has evaluated.
        torque_asked: The torque was to be switched on.
    """

    axes: list[Axis]
    loop: Loop
    pipelined: bool

    def __init__(
        self,
        config: Config,
        clock: Clock,
        telemetry: Telemetry,
        program: Sequence[Phase],
        surroundings: Surroundings,
    ) -> None:
        """Open the bus; arguments as of ``run_session``."""
        self.config = config
        self.configs = config.each
        self._clock = clock
        self._telemetry = telemetry
        self._program = program
        self._around = surroundings
        self.torque_asked = False
        self.work = Work()
        self.decided: list[tuple[Bins, GainTable]] = []
        self.checks: list[Check] = []
        self._inbox = Inbox(telemetry)
        self.bus = surroundings.open_bus(config.servos(), clock, surroundings.port)
        self.bus.given_up = lambda: bool(telemetry.words[Word.STOP])

    def prepare(self) -> None:
        """Do all long computations: a started servo needs a frame within its watchdog's time."""
        self._decide()
        if not self._program:
            for config, servo in self._each():
                clip_of(config, servo.facts)  # refused before any torque
        freeze_garbage()
        self._around.take_real_time()
        self._wait = waiter_for(self._clock, self.config.period_ns)

    def _decide(self) -> None:
        """Compute the guard's decisions from the servos' known values, of equal axes once."""
        self._know()
        known: dict[str, tuple[Bins, GainTable]] = {}
        self.decided = []
        for config, servo in self._each():
            asked = repr((config.request(servo.facts.position_step), situation_of(config, servo)))
            if asked not in known:
                program = bool(self._program)
                bins = bins_of(config, servo, program=program, work=self.work)
                known[asked] = bins, gain_table(config, bins)
            self.decided.append(known[asked])

    def _know(self) -> None:
        """Take the facts of the servos, and the longest of their delays.

        From the shortest of all on: on a flexible transmission that may be the less safe one.
        """
        delays = [config.belief().delay for config in self.configs.values()]
        lag = max(delays, key=lambda delay: delay.high)
        lag = replace(lag, low=min(delay.low for delay in delays))
        self.servos = [KnownServo(each, self.bus.traffic, lag) for each in self.bus.facts]

    def _each(self) -> Iterator[tuple[Config, KnownServo]]:
        """Return configuration and servo of each axis."""
        return zip(self.configs.values(), self.servos, strict=True)

    def start(self) -> None:
        """Check the servo, switch its torque on, and build the cycle; the loop then runs."""
        config, bus, telemetry = self.config, self.bus, self._telemetry
        asked = config.servo.schedule
        telemetry.words[Word.STATE] = LoopState.STARTING  # first: see Supervisor
        if not telemetry.words[Word.STOP]:  # no torque is switched on for a session that is to stop
            self.torque_asked = True
            if isinstance(self._clock, ElasticClock):
                self._clock.engage()
            with suppress(GivenUpError):
                self._start_bus()
        self.pipelined = asked == "pipelined"
        longest_s = 0.0 if bus.traffic is None else bus.traffic.longest_s
        if asked == "auto" and longest_s > COLLECT_SHARE * config.period_ns * 1e-9:
            self.pipelined = True
            told = f"the adapter holds replies for {longest_s * 1e3:.2g} ms"
            self._around.tell(f"schedule pipelined: {told}")
        self._know()
        shared = Shared()
        self.axes = [
            assembled(one, servo, telemetry, self._inbox, shared, *decided, self._program)
            for (one, servo), decided in zip(self._each(), self.decided, strict=True)
        ]
        self._inbox.tell(self.servos)
        parts = (self._clock, bus, self.axes, telemetry.words, self._inbox, config.period_ns)
        self.loop = Loop(
            Cycle(*parts, pipelined=self.pipelined),
            self._wait,
            self._clock,
            telemetry,
            config.period_ns,
            self._between_ticks,
            self._around.read_key,
        )
        telemetry.words[Word.HEARTBEAT_NS] = self._clock.now_ns()
        telemetry.words[Word.STATE] = LoopState.RUNNING

    def _start_bus(self) -> None:
        """Switch the torques on; decide again if the torque limits are others than known.

        Raises:
            GivenUpError: The session is to stop; all torques are off.
        """
        bus, limits = self.bus, [servo.facts.torque_limit for servo in self.servos]
        try:
            self.checks = self._named(bus.start())
        except ServoError as error:
            self._name_axis(error)
            raise
        if [each.torque_limit for each in bus.facts] != limits:  # their own Current Limits
            self._decide()
        passed = f", {len(self.checks)} start-up checks passed" if self.checks else ""
        names = ", ".join(self.configs) or bus.facts[0].name
        self._around.tell(f"{names}: torque is on{passed}")

    def _named(self, checks: list[list[Check]]) -> list[Check]:
        """Return the checks of all servos; the names of several have their axis before them."""
        return [
            replace(check, name=f"{axis}: {check.name}") if axis else check
            for axis, some in zip(self.configs, checks, strict=True)
            for check in some
        ]

    def number(self, servo_id: int | None) -> int:
        """Return the number of the axis whose servo has this id, from 1; 0: there is only one."""
        ids = [one.servo.id for one in self.configs.values()]
        return ids.index(servo_id) + 1 if servo_id in ids and len(ids) > 1 else 0

    def _name_axis(self, error: ServoError) -> None:
        """Let an error about the servo of one of several axes name it."""
        if number := self.number(error.id):
            axis, told = list(self.configs)[number - 1], error.problem
            error.problem = replace(told, what=f"{axis}: {told.what}")
            error.args = (str(error.problem),)

    def _between_ticks(self) -> None:
        """Pass on the health of the hottest servo, and call ``on_block``."""
        if health := self.bus.health():
            volts, celsius = max(health, key=lambda each: each[1])
            self._telemetry.words[Word.TEMPERATURE_MC] = round(1e3 * celsius)
            self._telemetry.words[Word.SUPPLY_MV] = round(1e3 * volts)
        self._around.on_block()
