"""The one place that turns settings into a servo; imports only what the settings name.

What is not simulated by its settings never becomes simulated: a port that cannot be opened is an
error, not a reason to run something else.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Final

from haptic_wall.hw.clock import Clock, SimulatedClock
from haptic_wall.hw.errors import PortError
from haptic_wall.hw.servo import Servo
from haptic_wall.hw.settings import DynamixelSettings, ServoSettings, SimulatedSettings, TrueServo

if TYPE_CHECKING:
    from haptic_wall.hw.dynamixel.line import Line
    from haptic_wall.hw.dynamixel.port_users import PortUsers

EMULATED_FIRMWARE: Final = 48
"""Of the emulated servo in memory: knows everything the driver wants of a servo"""


def torque_models() -> dict[str, bool]:
    """The models that can be commanded in torque, and whether their torque constant is published.

    Of those whose constant is not, it must be measured and configured.
    """
    from haptic_wall.hw.dynamixel.tables import MODELS

    return {
        model.name: model.torque_constant is not None
        for model in MODELS.values()
        if model.current_mode
    }


def no_load_speeds() -> dict[str, float]:
    """No-load speed [rad/s] of the models that can be commanded in torque.

    At the supply that their figures hold for.
    """
    from haptic_wall.hw.dynamixel.tables import MODELS

    return {model.name: model.no_load_speed for model in MODELS.values() if model.current_mode}


def check_fault(spec: str, servo_id: int) -> None:
    """Whether an emulated bus with this servo would take a fault of ``DynamixelSettings.faults``.

    Args:
        spec: The fault, as text.
        servo_id: The one id on the bus.

    Raises:
        ValueError: It is no fault, or one of a servo that is not there.
    """
    from haptic_wall.hw.emulated.faults import parse_fault

    parse_fault(spec).check_servo([servo_id])


def open_port(settings: DynamixelSettings) -> int:
    """Open the servo's serial port for this process and those it hands the descriptor to.

    Returns:
        A descriptor for ``open_servo`` and ``cut_torque``; whoever opens it closes it.

    Raises:
        PortError: The port cannot be used.
        PortBusyError: Another program holds it.
    """
    from haptic_wall.hw.dynamixel import cut, port, serial_line  # noqa: F401 - to cut the torque without delay

    if not settings.port:
        raise PortError(
            "No serial port is configured: set servo.port to the adapter's device, "
            "e.g. /dev/ttyUSB0."
        )
    return port.open_port(settings.port, settings.baud)


def port_users(descriptor: int) -> PortUsers | None:
    """Keep an open port from other programs, and find those that use it all the same.

    Args:
        descriptor: As from ``open_port``; stays open.

    Returns:
        What looks for them, to be closed before the port; None where it is no serial port.
    """
    from haptic_wall.hw.dynamixel.port_users import PortUsers

    return PortUsers(descriptor) if os.isatty(descriptor) else None


def open_servo(settings: ServoSettings, clock: Clock, descriptor: int | None = None) -> Servo:
    """The servo that ``settings`` describe, not started.

    Args:
        settings: Which servo, and where.
        clock: Tells it the time.
        descriptor: Its port, where it is already open (as from ``open_port``, perhaps inherited);
            the servo's ``close`` closes it, and so does a refusal. None: open the port here.

    Raises:
        PortError: The port cannot be used.
        PortBusyError: Another program holds it.
        UnfitServoError: The model cannot be driven in torque as configured.
        ValueError: What is to be simulated or emulated cannot exist.
    """
    if isinstance(settings, SimulatedSettings):
        from haptic_wall.hw.simulated import SimulatedServo

        return SimulatedServo(settings, clock)

    from haptic_wall.hw.dynamixel.servo import DynamixelServo

    if descriptor is None and not settings.port and settings.emulated is not None:
        if not isinstance(clock, SimulatedClock):
            raise PortError(
                "An emulated bus in memory runs on the simulated clock only: set "
                "loop.clock=simulated, or start `haptic-wall emulate` and set servo.port to its "
                "path."
            )
        return DynamixelServo(settings, _memory_line(settings, settings.emulated, clock))

    from haptic_wall.hw.dynamixel.serial_line import FdLine

    if descriptor is None:
        descriptor = open_port(settings)
    line = FdLine(descriptor, clock)
    try:
        return DynamixelServo(settings, line)
    except BaseException:
        line.close()
        raise


def _memory_line(settings: DynamixelSettings, true: TrueServo, clock: SimulatedClock) -> Line:
    """An emulated bus in memory with the configured servo on it."""
    from haptic_wall.hw.dynamixel.drivable import drivable
    from haptic_wall.hw.emulated.bus import EmulatedBus
    from haptic_wall.hw.emulated.injection import Faults
    from haptic_wall.hw.emulated.memory_line import MemoryLine
    from haptic_wall.hw.emulated.servo import EmulatedServo

    model, _ = drivable(settings)
    now_ns = clock.now_ns()
    servo = EmulatedServo(
        model,
        settings.id,
        EMULATED_FIRMWARE,
        true,
        start_ns=now_ns,
        baud=settings.baud,
    )
    bus = EmulatedBus(
        [servo],
        baud=settings.baud,
        start_ns=now_ns,
        faults=Faults(settings.faults, settings.fault_seed),
    )
    return MemoryLine(bus, clock)


def cut_torque(settings: DynamixelSettings, descriptor: int, clock: Clock) -> bool:
    """Switch off the torque of a servo whose driver is dead or hung.

    See ``haptic_wall.hw.dynamixel.cut``.

    Args:
        settings: Which servo.
        descriptor: Its port; stays open.
        clock: Tells the time.

    Returns:
        Whether torque off was read back.
    """
    from haptic_wall.hw.dynamixel import cut
    from haptic_wall.hw.dynamixel.serial_line import FdLine

    return cut.cut_torque(FdLine(descriptor, clock), settings.id, settings.baud)
