"""A whole session on an emulated bus in memory, where faults, adapter and truth are at hand.

Controller, driver, codec and emulator as they are, on the simulated clock: the same every time.
"""

import bisect
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.runtime.session import run_session
from haptic_wall.controller.runtime.session_result import Result
from haptic_wall.controller.runtime.session_start import Surroundings
from haptic_wall.controller.runtime.telemetry import ROW, Telemetry
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.clock import Clock, SimulatedClock
from haptic_wall.hw.dynamixel.codec import Instruction
from haptic_wall.hw.dynamixel.group import DynamixelGroup
from haptic_wall.hw.dynamixel.registers import POSITION_UNIT
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.emulated.adapter import Adapter
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.memory_line import MemoryLine
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.emulated.witness import Event, Witness
from haptic_wall.hw.servo import Bus
from haptic_wall.hw.settings import ServoSettings

LIMITS_OF_HARDWARE = (
    "safety.max_speed=15",
    "safety.max_loss=0.05",
    "safety.max_silence_s=0.015",
    "safety.heartbeat_s=0.1",
    "servo.watchdog_s=0.04",
)
FIRMWARE = 48
MS_NS = 1_000_000
AFTERWARDS_NS = 200_000_000
"""So long the bus is looked at when the run is over [ns]: what is left on ends meanwhile"""


class Notes(Witness):
    """A witness that keeps its rows."""

    def __init__(self) -> None:
        super().__init__(io.StringIO())
        self.rows: list[Event] = []

    def add(self, row: Event) -> None:
        """Keep a row."""
        self.rows.append(row)


@dataclass(frozen=True, slots=True)
class MemorySession:
    """The program's result, and the truth."""

    result: Result
    ticks: np.ndarray
    """Rows of the first axis, warm-up included"""
    truth: list[Event]
    """The witness's rows, to some time after the end"""
    given_ns: int
    """When the faults were given: the loop's grid begins a period later [ns]"""


def run_in_memory(
    sets: Sequence[str],
    duration_s: float,
    *,
    faults: Sequence[str] = (),
    adapter: tuple[int, int] | None = None,
    shift_ns: int = 0,
    preset: str = "emulated-ideal",
) -> MemorySession:
    """Run a preset of an emulated servo in memory.

    Args:
        sets: Changes to it, as for ``--set``.
        duration_s: How long the wall is on [s].
        faults: Given to the bus when torque is on, from when their times count.
        adapter: Its timer [ns] and its block [bytes]; None: none.
        shift_ns: The loop's grid is so much later than whole milliseconds [ns]; what moves it
            through the phases of the adapter's timer.
        preset: Its name.
    """
    config = load_config(preset, ("loop.clock=simulated", *sets)).config
    clock = SimulatedClock()
    notes = Notes()
    buses = []
    given_ns: list[int] = []

    def opener(servos: Sequence[ServoSettings], _clock: Clock, _port: int | None) -> Bus:
        baud = servos[0].baud
        truths = [
            EmulatedServo(MODELS[one.model], one.id, FIRMWARE, one.true, start_ns=0, baud=baud)
            for one in servos
            if one.true is not None
        ]
        bus = EmulatedBus(
            truths,
            baud=baud,
            start_ns=0,
            witness=notes,
            adapter=None if adapter is None else Adapter(*adapter, 0),
        )
        buses.append(bus)
        return DynamixelGroup(servos, MemoryLine(bus, clock))

    def tell(text: str) -> None:
        if "torque is on" in text:
            clock.wait_until(-(-clock.now_ns() // MS_NS) * MS_NS + shift_ns)
            given_ns.append(clock.now_ns())
            for fault in faults:
                buses[0].inject(fault, clock.now_ns())

    telemetry = Telemetry.create(len(config.each))
    blocks: list[np.ndarray] = []
    read = 0

    def on_block() -> None:
        nonlocal read
        rows, read = telemetry.read(read)
        blocks.append(rows[:, 0])

    around = Surroundings(on_block=on_block, tell=tell, open_bus=opener)
    result = run_session(config, clock, telemetry, duration_s, surroundings=around)
    buses[0].transmit(clock.now_ns() + AFTERWARDS_NS)
    ticks = np.concatenate(blocks) if blocks else np.empty(0, ROW)
    return MemorySession(result, ticks, notes.rows, given_ns[0])


def mistaken(run: MemorySession) -> int:
    """Positions in use that are not those of the request they are said to answer.

    The witness has the true position at the instant each request had arrived.
    """
    reads = [row for row in run.truth if row.event == "rx" and row.instruction == Instruction.READ]
    times = [row.time_ns for row in reads]
    wrong = 0
    for tick in run.ticks:
        if tick["sampled_ns"]:
            asked = reads[bisect.bisect_left(times, int(tick["sampled_ns"]))]
            wrong += abs(tick["position"] - asked.state.position) > 1.01 * POSITION_UNIT
    return wrong
