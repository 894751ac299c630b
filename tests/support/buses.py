"""Buses of several servos on the simulated clock."""

from __future__ import annotations

from collections.abc import Sequence

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.group import DynamixelGroup
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.memory_line import MemoryLine
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.settings import DriverSettings
from haptic_wall.hw.truth import TrueServo

MODEL, BAUD, FIRMWARE = "XM430-W350", 4_000_000, 48
TRUE = TrueServo(inertia=0.012, damping=0.012, coulomb=0.09)


def emulated_bus(trues: Sequence[TrueServo], clock: SimulatedClock) -> DynamixelGroup:
    """The driver of emulated servos 1, 2, ... on a bus in memory; the start has no probe."""
    now_ns = clock.now_ns()
    servos = [
        EmulatedServo(MODELS[MODEL], n, FIRMWARE, true, start_ns=now_ns, baud=BAUD)
        for n, true in enumerate(trues, start=1)
    ]
    line = MemoryLine(EmulatedBus(servos, baud=BAUD, start_ns=now_ns), clock)
    settings = [DriverSettings("", BAUD, servo.id, MODEL, probe_torque=0.0) for servo in servos]
    return DynamixelGroup(settings, line)
