"""Opens a bus of servos: simulated in this process, or Dynamixel servos, real or emulated.

A real servo is never replaced by a simulated one: a port that cannot be opened is an error. Modules
are imported on use: most configurations are only checked.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from haptic_wall.hw.clock import Clock, SimulatedClock
from haptic_wall.hw.errors import PortError, Problem, SpecError
from haptic_wall.hw.hand import SharedHand
from haptic_wall.hw.names import did_you_mean
from haptic_wall.hw.servo import Bus
from haptic_wall.hw.settings import ServoSettings

if TYPE_CHECKING:
    from haptic_wall.hw.dynamixel.tables import Model
    from haptic_wall.hw.serialport.line import Line

EMULATED_FIRMWARE: Final = 48
"""Of the emulated servo in memory: knows everything the driver wants of a servo"""


def torque_models() -> Mapping[str, Model]:
    """Return the models that can be commanded in torque, by name."""
    from haptic_wall.hw.dynamixel.tables import MODELS

    return MODELS


def other_model(name: str) -> str:
    """Return advice for a name that is none of ``torque_models``; empty: there is none."""
    from haptic_wall.hw.dynamixel.tables import MODELS, NO_CURRENT_MODE

    asked = name.strip().upper()
    series = asked.partition("-")[0]
    alike = [known for known in NO_CURRENT_MODE.values() if known.partition("-")[0] == series]
    if alike:
        named = asked if asked in alike else alike[0]
        return f"the {named} has no current mode, so that no torque can be commanded"
    return did_you_mean(asked, MODELS)


def problems(servos: Sequence[ServoSettings]) -> Iterator[Problem]:
    """Yield models that no supply suits, and faults that an emulated bus would not take.

    The field of each is a configuration path.
    """
    if servos[0].backend == "simulated":
        return
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


def cycle_time(servos: Sequence[ServoSettings]) -> float:
    """Return the time of a cycle on the wire, by the fastest way to read that is allowed [s].

    0: there is no wire.
    """
    bus, count = servos[0], len(servos)
    if bus.backend == "simulated":
        return 0.0
    from haptic_wall.hw.dynamixel.wire import cycle_s

    read = "plain" if count == 1 else "fast" if bus.read == "auto" else bus.read
    return cycle_s(bus.baud, count, read)


def open_bus(
    servos: Sequence[ServoSettings],
    clock: Clock,
    descriptor: int | None = None,
    hand: SharedHand | None = None,
) -> Bus:
    """Return the bus of these servos, not started.

    Args:
        servos: At least one; backend, port and the other settings of a bus are those of the first.
        clock: Their clock.
        descriptor: Their port, where it is already open (from ``open_port``, perhaps
            inherited); the bus's ``close`` closes it, and so does a refusal. None: open it here.
        hand: A person's hand that can hold the shafts of servos simulated in this process.

    Raises:
        PortError: The port cannot be used.
        PortBusyError: Another program has it.
        UnfitServoError: A servo cannot be driven in torque as configured.
        ValueError: A simulated or emulated servo is impossible.
    """
    bus = servos[0]
    if bus.backend == "simulated":
        from haptic_wall.hw.simulated import SimulatedBus

        trues = [one.true for one in servos if one.true is not None]
        if len(trues) < len(servos):
            raise ValueError("found None in ServoSettings.true, wanted the truth of the servo")
        simulated = SimulatedBus(trues, clock, bus.arm)
        if hand is not None:
            simulated.take_hand(hand)
        return simulated
    from haptic_wall.hw.dynamixel.group import DynamixelGroup

    if descriptor is None and not bus.port and bus.true is not None:
        if not isinstance(clock, SimulatedClock):
            raise PortError(
                "An emulated bus in memory runs on the simulated clock only",
                advice="set loop.clock=simulated, or start `haptic-wall emulate` and set "
                "servo.port to its path.",
            )
        return DynamixelGroup(servos, _memory_line(servos, clock))

    from haptic_wall.hw.serialport.line import FdLine

    line = FdLine(_opened(bus) if descriptor is None else descriptor, clock)
    try:
        return DynamixelGroup(servos, line)
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


def find_port(port: str) -> None:
    """Refuse a port that does not exist; it is not opened.

    Raises:
        PortError: There is none, or it is no device.
    """
    from haptic_wall.hw.serialport.port import device_number

    device_number(port)


def open_port(servos: Sequence[ServoSettings]) -> int | None:
    """Return the servos' open port, which the caller closes; None: they have none.

    It is for this process and those it passes the descriptor to; the modules of ``cut_torque`` are
    loaded then.

    Raises:
        PortError: The port cannot be used.
    """
    return None if servos[0].backend == "simulated" else _opened(servos[0])


def _opened(bus: ServoSettings) -> int:
    from haptic_wall.hw.dynamixel import cut  # noqa: F401 - to cut the torque without delay
    from haptic_wall.hw.serialport import line, port  # noqa: F401

    if not bus.port:
        raise PortError(
            "No serial port is configured",
            advice="set servo.port to the adapter's device, e.g. /dev/ttyUSB0.",
        )
    return port.open_port(bus.port, bus.baud)


def reserved(descriptor: int) -> AbstractContextManager[None]:
    """Return what keeps other programs off an open port, in a block that ends before it is closed.

    Args:
        descriptor: Descriptor from ``open_port``.
    """
    from haptic_wall.hw.serialport import users

    return users.reserved(descriptor)


def cut_torque(servos: Sequence[ServoSettings], descriptor: int | None, clock: Clock) -> bool:
    """Switch off the torque of servos whose driver is dead or hung.

    Args:
        servos: The servos.
        descriptor: Their port, which stays open; None: it was not opened.
        clock: Their clock.

    Returns:
        Whether that was read back from each; simulated ones have ended with their process.
    """
    if servos[0].backend == "simulated":
        return True
    if descriptor is None:
        return False
    from haptic_wall.hw.dynamixel import cut
    from haptic_wall.hw.serialport.line import FdLine

    ids = [one.id for one in servos]
    return cut.cut_torque(FdLine(descriptor, clock), ids, servos[0].baud)
