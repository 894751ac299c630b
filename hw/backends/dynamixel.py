"""The backend of Dynamixel servos: on a serial port, real or emulated, or on a bus in memory.

It imports its modules on use: most configurations that name it are only checked.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from haptic_wall.hw.backend import Backend, TorqueModel
from haptic_wall.hw.clock import Clock, SimulatedClock
from haptic_wall.hw.dynamixel.wire import cycle_s
from haptic_wall.hw.errors import PortError, Problem, SpecError
from haptic_wall.hw.servo import Bus
from haptic_wall.hw.settings import ServoSettings

if TYPE_CHECKING:
    from haptic_wall.hw.serialport.line import Line

EMULATED_FIRMWARE: Final = 48
"""Of the emulated servo in memory: knows everything the driver wants of a servo"""


def _models() -> Mapping[str, TorqueModel]:
    """Return the models that can be commanded in torque."""
    from haptic_wall.hw.dynamixel.tables import MODELS

    return {
        model.name: TorqueModel(model.torque_constant is not None, model.no_load_speed)
        for model in MODELS.values()
    }


def _problems(servos: Sequence[ServoSettings]) -> Iterator[Problem]:
    """Models that no supply suits, and faults that an emulated bus would not take."""
    if len(servos) > 1:
        yield from _supply(servos)
    if not servos[0].faults:
        return
    from haptic_wall.hw.emulated.faults import parse_fault

    for spec in servos[0].faults:
        try:
            parse_fault(spec).check_servo([one.id for one in servos])
        except SpecError as error:
            problem = error.problem
            if problem.given:
                problem = replace(problem, what=f"{problem.given}: {problem.what}", given="")
            if "=" in spec.split(":")[0]:  # it was cut at the commas of a list
                hint = "in a list, quote a fault that has commas"
                problem = Problem(str(problem), advice=hint)
            yield replace(problem, field="servo.faults")


def _supply(servos: Sequence[ServoSettings]) -> Iterator[Problem]:
    """Models on one bus whose ranges of the supply, from the factory, do not meet."""
    from haptic_wall.hw.dynamixel.tables import MODELS

    models = [MODELS[one.model] for one in servos if one.model in MODELS]
    low = max(models, key=lambda model: model.supply[0], default=None)
    high = min(models, key=lambda model: model.supply[1], default=None)
    if low and high and low.supply[0] > high.supply[1]:
        told = (f"{one.name} ({one.supply[0]:g} to {one.supply[1]:g} V)" for one in (low, high))
        yield Problem(
            f"found {' and '.join(told)} on one bus, and no supply suits both",
            advice="drive them on buses of their own",
            field="servo.model",
        )


def _cycle_s(servos: Sequence[ServoSettings]) -> float:
    """Return the time of a cycle, by the fastest way to read that is allowed [s]."""
    bus, count = servos[0], len(servos)
    read = "plain" if count == 1 else "fast" if bus.read == "auto" else bus.read
    return cycle_s(bus.baud, count, read)


def _open_port(servos: Sequence[ServoSettings]) -> int:
    from haptic_wall.hw.dynamixel import cut  # noqa: F401 - to cut the torque without delay
    from haptic_wall.hw.serialport import line, port  # noqa: F401

    bus = servos[0]
    if not bus.port:
        raise PortError(
            "No serial port is configured",
            advice="set servo.port to the adapter's device, e.g. /dev/ttyUSB0.",
        )
    return port.open_port(bus.port, bus.baud)


def _open(servos: Sequence[ServoSettings], clock: Clock, descriptor: int | None) -> Bus:
    from haptic_wall.hw.dynamixel.group import DynamixelGroup

    drivers = [one.driver() for one in servos]
    if descriptor is None and not servos[0].port and servos[0].true is not None:
        if not isinstance(clock, SimulatedClock):
            raise PortError(
                "An emulated bus in memory runs on the simulated clock only",
                advice="set loop.clock=simulated, or start `haptic-wall emulate` and set "
                "servo.port to its path.",
            )
        return DynamixelGroup(drivers, _memory_line(servos, clock))

    from haptic_wall.hw.serialport.line import FdLine

    line = FdLine(_open_port(servos) if descriptor is None else descriptor, clock)
    try:
        return DynamixelGroup(drivers, line)
    except BaseException:
        line.close()
        raise


def _memory_line(servos: Sequence[ServoSettings], clock: SimulatedClock) -> Line:
    """Return an emulated bus in memory with the configured servos on it."""
    from haptic_wall.hw.dynamixel.driven import drivable
    from haptic_wall.hw.emulated.bus import EmulatedBus
    from haptic_wall.hw.emulated.injection import Faults
    from haptic_wall.hw.emulated.memory_line import MemoryLine
    from haptic_wall.hw.emulated.servo import EmulatedServo

    first, now_ns = servos[0], clock.now_ns()
    moving = [
        EmulatedServo(
            drivable(one)[0],
            one.id,
            EMULATED_FIRMWARE,
            one.true,
            start_ns=now_ns,
            baud=first.baud,
        )
        for one in servos
        if one.true is not None
    ]
    bus = EmulatedBus(
        moving,
        baud=first.baud,
        start_ns=now_ns,
        faults=Faults(first.faults, first.fault_seed),
        arm=first.arm,
    )
    return MemoryLine(bus, clock)


def _cut_torque(servos: Sequence[ServoSettings], descriptor: int | None, clock: Clock) -> bool:
    """See ``haptic_wall.hw.dynamixel.cut``."""
    from haptic_wall.hw.dynamixel import cut
    from haptic_wall.hw.serialport.line import FdLine

    if descriptor is None:
        return False
    ids = [one.id for one in servos]
    return cut.cut_torque(FdLine(descriptor, clock), ids, servos[0].baud)


BACKEND = Backend(
    open=_open,
    required={
        "port": "a serial device such as /dev/ttyUSB0, or emulated",
        "baud": "the speed the servo is set to, e.g. 4000000",
        "model": "the servo's model, e.g. XM430-W350",
    },
    models=_models,
    cycle_s=_cycle_s,
    problems=_problems,
    open_port=_open_port,
    cut_torque=_cut_torque,
)
